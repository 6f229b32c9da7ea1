"""Rules along rays: the kernel is the plain reference, in values and gradients, in any layout, and stores no sample."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from unproject._random import generator_at
from unproject.ops import ray_rules
from unproject.ops.azimuth import PlaneRays
from unproject.ops.ray_rules import RAY_RULES, RayRule, ray_values, ray_values_plain

rules = pytest.mark.parametrize("rule", RAY_RULES)
shapes = st.tuples(st.integers(1, 9), st.integers(1, 19), st.integers(1, 9))
sampling = st.tuples(st.integers(1, 9), st.floats(0.2, 2.5), st.integers(1, 13), st.floats(0.5, 2))
extents = st.tuples(st.floats(0.5, 2), st.floats(0.5, 2))
azimuths = st.lists(st.floats(-7, 7), min_size=1, max_size=3)


def volumes(*shape: int, seed: int = 0) -> Tensor:
    """Occupancies in float64, full in a fifth of the places and empty in another."""
    return (torch.rand(*shape, generator=generator_at(seed), dtype=torch.float64) * 5 / 3 - 1 / 3).clamp(0, 1)


def rays_of(plane: tuple[int, int], azimuth: Tensor) -> PlaneRays:
    """Rays whose viewports and offsets differ, some of which miss the volume."""
    viewport, offset = torch.linspace(0.7, 1.6, len(azimuth)), torch.linspace(-0.4, 0.5, len(azimuth))
    places = viewport.to(azimuth), offset.to(azimuth)
    return PlaneRays(azimuth, plane, 7, places[0], 11, 1.5, (1.2, 0.9), places[1])


def values_and_gradients(f: Callable[..., Tensor], x: Tensor, rays: PlaneRays, rule: RayRule) -> tuple[Tensor, ...]:
    x, azimuth = x.detach().requires_grad_(), rays.azimuth.detach().requires_grad_()
    y = f(x, replace(rays, azimuth=azimuth), rule)
    weight = torch.randn(y.transpose(1, -1).shape, generator=generator_at(3), dtype=y.dtype).transpose(1, -1)
    return y.detach(), *torch.autograd.grad(y, (x, azimuth), weight)


def compiled() -> bool:
    return ray_rules._kernel("sum", "forward", torch.empty(0)) is not None


@rules
@settings(deadline=None, max_examples=25)
@given(shapes, sampling, azimuths, extents)
def test_the_kernel_is_the_reference_in_values_and_gradients(rule, shape, sampling, azimuth, extent) -> None:  # noqa: ANN001
    size, viewport, samples, half_depth = sampling
    angles, plane = torch.tensor(azimuth, dtype=torch.float64), (shape[0], shape[2])
    rays = PlaneRays(angles, plane, size, viewport, samples, half_depth, extent)
    x = volumes(len(azimuth), *shape)
    found = [values_and_gradients(f, x, rays, rule) for f in (ray_values, ray_values_plain)]
    for quick, plain in zip(*found, strict=True):
        torch.testing.assert_close(quick, plain, atol=1e-8, rtol=1e-7)


@rules
def test_each_item_has_its_own_window(rule: RayRule) -> None:
    x, rays = volumes(3, 6, 5, 4), rays_of((6, 4), torch.tensor([0.3, 2.0, -4.0], dtype=torch.float64))
    found = [values_and_gradients(f, x, rays, rule) for f in (ray_values, ray_values_plain)]
    for quick, plain in zip(*found, strict=True):
        torch.testing.assert_close(quick, plain, atol=1e-9, rtol=0)
    assert bool((found[0][0] == 0).any()) and bool((found[0][0] > 0.5).any())


@rules
def test_in_single_precision(rule: RayRule) -> None:
    x, rays = volumes(2, 16, 16, 16).float(), rays_of((16, 16), torch.tensor([0.3, 2.0]))
    found = [values_and_gradients(f, x, rays, rule)[:2] for f in (ray_values, ray_values_plain)]
    for quick, plain in zip(*found, strict=True):
        # The capped sum jumps where rounding decides whether a sample still fits.
        assert ((quick - plain).abs() > 1e-4).double().mean() <= (1e-3 if rule == "alpha" else 0)


@rules
def test_layouts_in_memory_do_not_matter(rule: RayRule) -> None:
    x, rays = volumes(2, 17, 18, 19), rays_of((17, 19), torch.tensor([0.3, 2.0], dtype=torch.float64))
    plain = values_and_gradients(ray_values, x, rays, rule)
    layouts = (x.transpose(2, 3).contiguous().transpose(2, 3), x.permute(3, 0, 2, 1).contiguous().permute(1, 3, 2, 0))
    for layout in (*layouts, x[:1].expand_as(x)):
        found = values_and_gradients(ray_values, layout, rays, rule)
        expected = (
            plain if torch.equal(layout, x) else values_and_gradients(ray_values, layout.contiguous(), rays, rule)
        )
        for one, other in zip(found, expected, strict=True):
            assert torch.equal(one, other)


@rules
def test_the_batch_may_be_divided_between_threads(rule: RayRule) -> None:
    rays, threads = rays_of((6, 4), torch.linspace(0, 5, 5).double()), torch.get_num_threads()
    x = volumes(5, 6, 3, 4)
    alone = values_and_gradients(ray_values, x, rays, rule)
    try:
        torch.set_num_threads(2)
        for one, other in zip(values_and_gradients(ray_values, x, rays, rule), alone, strict=True):
            assert torch.equal(one, other)
    finally:
        torch.set_num_threads(threads)
    nothing = replace(rays, azimuth=rays.azimuth[:0], viewport=1.0, offset=None)
    assert ray_values(x[:0], nothing, rule).shape[:2] == (0, 7)


@rules
def test_derivatives(rule: RayRule) -> None:
    """Samples and sums twice in the volume; all once in the azimuth. Volumes are such that no capped sum jumps."""
    x = (volumes(2, 3, 2, 4) * 0.05).requires_grad_()
    azimuth = torch.tensor([0.4, 2.0], dtype=torch.float64, requires_grad=True)
    rays = PlaneRays(azimuth, (3, 4), 3, 1.2, 4, 1.5)
    assert torch.autograd.gradcheck(lambda v, a: ray_values(v, replace(rays, azimuth=a), rule), (x, azimuth))
    fixed = replace(rays, azimuth=azimuth.detach())
    if rule in ("samples", "sum"):
        assert torch.autograd.gradgradcheck(lambda v: ray_values(v, fixed, rule).square(), (x,))
        (slope,) = torch.autograd.grad(ray_values(x, rays, rule).square().sum(), azimuth, create_graph=True)
        with pytest.raises((NotImplementedError, RuntimeError), match="not implemented"):
            slope.sum().backward()


@rules
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_view_that_has_broken_down_shows_and_harms_no_other(rule: RayRule, bad: float) -> None:
    x, rays = volumes(2, 4, 4, 4).requires_grad_(), rays_of((4, 4), torch.tensor([0.3, bad], dtype=torch.float64))
    for values in (ray_values, ray_values_plain):
        y = values(x, rays, rule)
        assert y[1].isnan().all() and y[0].isfinite().all()
        (gradient,) = torch.autograd.grad(y[0].sum(), x)
        assert gradient[0].isfinite().all()


def test_opaque_rays_have_the_gradient_of_the_first_that_opens() -> None:
    """Two full voxels behind one another: each alone keeps the ray dark, so that neither has a gradient."""
    x = torch.zeros(1, 1, 1, 2, dtype=torch.float64)
    rays = PlaneRays(torch.zeros(1, dtype=torch.float64), (1, 2), 1, 1.0, 2, 1.0)
    for voxels, expected in (((1.0, 0.0), (1.0, 1e-6)), ((1.0, 1.0), (1e-6, 1e-6))):
        x[0, 0, 0] = torch.tensor(voxels)
        (gradient,) = torch.autograd.grad(ray_values(x.requires_grad_(), rays, "any").sum(), x)
        torch.testing.assert_close(gradient.flatten(), torch.tensor(expected, dtype=torch.float64), rtol=1e-4, atol=0)
        x = x.detach()


def test_without_a_compiler_or_with_learned_windows_values_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    x, rays = volumes(2, 4, 4, 4), rays_of((4, 4), torch.tensor([0.3, 2.0], dtype=torch.float64))
    quick = ray_values(x, rays, "any")
    learned = replace(rays, viewport=torch.as_tensor(rays.viewport).requires_grad_())
    assert ray_values(x, learned, "any").requires_grad
    torch.testing.assert_close(ray_values(x, learned, "any").detach(), quick, atol=1e-9, rtol=0)
    monkeypatch.setenv("UNPROJECT_NATIVE", "0")
    assert not compiled()
    torch.testing.assert_close(ray_values(x, rays, "any"), quick, atol=1e-9, rtol=0)


@pytest.mark.skipif(not compiled(), reason="no compiler")
def test_no_sample_is_stored(monkeypatch: pytest.MonkeyPatch) -> None:
    def stored(*_: object) -> Tensor:
        raise AssertionError("samples were stored")

    monkeypatch.setattr(ray_rules, "ray_samples", stored)
    x, rays = volumes(2, 4, 4, 4), rays_of((4, 4), torch.tensor([0.3, 2.0], dtype=torch.float64))
    for rule in RAY_RULES:
        values_and_gradients(ray_values, x, rays, rule)
