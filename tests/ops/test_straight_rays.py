"""Sums along straight rays: the kernel is the plain reference, in values and gradients, and reads no cell outside."""

from __future__ import annotations

import math

import pytest
import torch

from unproject._random import generator_at
from unproject.ops import camera_frame, pinhole_rays
from unproject.ops.straight_rays import ray_sums_plain, straight_ray_sums


def random_rays(batch: int, count: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Origins and directions in float64: some rays miss the volume, some graze its faces."""
    origin, direction = (torch.randn(2, batch, count, 3, generator=generator_at(1))).double()
    return origin * 0.7, direction


def volumes(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, generator=generator_at(0)).double()


@pytest.mark.parametrize("shape", [(3, 6, 6, 6), (2, 5, 9, 3), (4, 1, 2, 7)])
def test_the_kernel_is_the_reference_in_values_and_gradients(shape: tuple[int, ...]) -> None:
    results = []
    for sums in (straight_ray_sums, ray_sums_plain):
        parts = [part.requires_grad_() for part in (volumes(*shape), *random_rays(shape[0], 300))]
        y = sums(*parts, 11, 1.5)  # type: ignore[arg-type]
        weight = torch.rand(y.shape, generator=generator_at(2), dtype=y.dtype)
        results.append((y, *torch.autograd.grad(y, parts, weight)))
    assert bool((results[0][0] == 0).any()) and bool((results[0][0] > 1).any())
    for quick, plain in zip(*results, strict=True):
        torch.testing.assert_close(quick, plain, atol=1e-9, rtol=1e-7)


def test_rays_along_the_axes_and_beside_the_volume() -> None:
    x = volumes(1, 4, 4, 4)
    frame = camera_frame(torch.tensor([0.0, math.pi / 2, 0.0]).double(), torch.tensor([0.0, 0.0, math.pi / 2]).double())
    origin, direction = pinhole_rays(frame, 9, 1.7, torch.zeros(3).double())
    quick, plain = (f(x.expand(3, -1, -1, -1), origin, direction, 8, 2.0) for f in (straight_ray_sums, ray_sums_plain))
    torch.testing.assert_close(quick, plain, atol=1e-9, rtol=0)
    assert not quick[:, 0].any()


def test_in_single_precision() -> None:
    x, (origin, direction) = volumes(2, 16, 16, 16).float(), (part.float() for part in random_rays(2, 2000))
    quick, plain = (f(x, origin, direction, 24, 1.5) for f in (straight_ray_sums, ray_sums_plain))
    torch.testing.assert_close(quick, plain, atol=1e-4, rtol=0)


def test_the_batch_may_be_divided_between_threads() -> None:
    x, rays, threads = volumes(5, 6, 6, 6), random_rays(5, 50), torch.get_num_threads()
    alone = straight_ray_sums(x, *rays, 9, 1.5)
    try:
        torch.set_num_threads(2)
        torch.testing.assert_close(straight_ray_sums(x, *rays, 9, 1.5), alone, atol=0, rtol=0)
        assert straight_ray_sums(x[:0], rays[0][:0], rays[1][:0], 9, 1.5).shape == (0, 50)
    finally:
        torch.set_num_threads(threads)


def test_differentiable_in_rays_once_and_in_the_volume_twice() -> None:
    x = volumes(2, 3, 4, 3).requires_grad_()
    rays = [ray.requires_grad_() for ray in random_rays(2, 5)]
    assert torch.autograd.gradcheck(lambda *parts: straight_ray_sums(*parts, 7, 1.5), (x, *rays))  # type: ignore[arg-type]
    fixed = [ray.detach() for ray in rays]
    assert torch.autograd.gradgradcheck(lambda x: straight_ray_sums(x, *fixed, 7, 1.5).square(), (x,))  # type: ignore[arg-type]
    (slope,) = torch.autograd.grad(straight_ray_sums(x, *rays, 7, 1.5).square().sum(), rays[:1], create_graph=True)
    with pytest.raises(NotImplementedError, match="by the rays is not implemented"):
        slope.sum().backward()


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e30])
def test_a_ray_that_has_broken_down_shows_and_harms_no_other(bad: float) -> None:
    x, (origin, direction) = volumes(1, 4, 4, 4).requires_grad_(), random_rays(1, 6)
    origin[0, 2, 1] = bad
    sums = straight_ray_sums(x, origin, direction, 7, 1.5)
    assert sums[0, 2].isnan() or bad == 1e30
    kept = [0, 1, 3, 4, 5]
    torch.testing.assert_close(sums[0, kept], ray_sums_plain(x, origin, direction, 7, 1.5)[0, kept])
    (gradient,) = torch.autograd.grad(sums[0, kept].sum(), x)
    assert gradient.isfinite().all()


def test_without_a_compiler_the_values_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    x, rays = volumes(2, 4, 4, 4), random_rays(2, 20)
    quick = straight_ray_sums(x, *rays, 7, 1.5)
    monkeypatch.setenv("UNPROJECT_NATIVE", "0")
    torch.testing.assert_close(straight_ray_sums(x, *rays, 7, 1.5), quick, atol=1e-9, rtol=0)
