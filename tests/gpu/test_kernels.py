"""Triton's kernels are the plain references, in values and gradients, and add up in one order.

On a GPU, or without one in Triton's interpreter: TRITON_INTERPRET=1 pytest tests/gpu/test_kernels.py, where Triton and
NumPy before 2.4 are installed, which the tests do not ask for.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject.ops import line_integrals, ray_rules
from unproject.ops.azimuth import PlaneRays
from unproject.ops.ray_rules import RAY_RULES, RayRule, ray_values_plain
from unproject.ops.rotation import cos_sin

pytestmark = pytest.mark.gpu
DEVICE = "cpu" if os.environ.get("TRITON_INTERPRET") == "1" else "cuda"
NEAR = {torch.float64: 1e-9, torch.float32: 1e-4}
Kernels = Any


@pytest.fixture(autouse=True)
def exact_float32() -> None:
    """In place of that of all tests here, which wants a GPU."""
    pytest.importorskip("triton")
    if DEVICE == "cuda" and not torch.cuda.is_available():
        pytest.skip("no CUDA device is there")


@pytest.fixture()
def of_rays(monkeypatch: pytest.MonkeyPatch) -> Callable[[Tensor, PlaneRays, RayRule], Tensor]:
    """`ray_values` by Triton, wherever tensors are."""
    from unproject.ops import ray_rules_triton

    for name in ("forward", "back", "slope"):
        monkeypatch.setattr(ray_rules, f"_{name}", getattr(ray_rules_triton, name))

    def values(volume: Tensor, rays: PlaneRays, rule: RayRule) -> Tensor:
        if rule in ("samples", "sum"):
            return ray_rules._Linear.apply(volume, rays.azimuth, rays, rule, False)
        return ray_rules._Nonlinear.apply(volume, rays.azimuth, rays, rule)

    return values


PLANES: dict[str, tuple[tuple[int, int, int], list[float], dict[str, Any]]] = {
    "windows": (
        (6, 5, 4),
        [0.3, 2.0, -4.0],
        {"size": 7, "viewport": [0.7, 1.0, 1.6], "samples": 11, "extent": (1.2, 0.9), "offset": [-0.4, 0.0, 0.5]},
    ),
    "quarter turns": ((5, 3, 7), [0.0, math.pi / 2], {"size": 6, "viewport": 1.0, "samples": 9}),
    "one voxel": ((1, 9, 1), [1.0], {"size": 1, "viewport": 0.5, "samples": 1, "half_depth": 0.7}),
    "deep": ((4, 1, 3), [0.1], {"size": 9, "viewport": 2.5, "samples": 13, "half_depth": 2.0, "extent": (0.5, 2.0)}),
    "blocks": ((3, 140, 2), [0.7], {"size": 2, "viewport": 1.0, "samples": 5}),
}


def rays_of(name: str, dtype: torch.dtype) -> tuple[Tensor, PlaneRays]:
    shape, azimuth, options = PLANES[name]
    placed = {k: torch.tensor(v, dtype=dtype, device=DEVICE) if isinstance(v, list) else v for k, v in options.items()}
    angles = torch.tensor(azimuth, dtype=dtype, device=DEVICE)
    drawn = torch.rand(len(azimuth), *shape, generator=generator_at(0), dtype=torch.float64)
    volume = (drawn * 5 / 3 - 1 / 3).clamp(0, 1).to(DEVICE, dtype)
    return volume, PlaneRays(angles, (shape[0], shape[2]), **{"half_depth": 1.5, **placed})


def found(f: Callable[..., Tensor], x: Tensor, rays: PlaneRays, rule: RayRule) -> tuple[Tensor, ...]:
    x, azimuth = x.detach().requires_grad_(), rays.azimuth.detach().requires_grad_()
    y = f(x, replace(rays, azimuth=azimuth), rule)
    weight = torch.randn(y.transpose(1, -1).shape, generator=generator_at(3), dtype=y.dtype).transpose(1, -1)
    return y.detach(), *torch.autograd.grad(y, (x, azimuth), weight.to(y.device))


@pytest.mark.parametrize("dtype", NEAR, ids=str)
@pytest.mark.parametrize("rule", RAY_RULES)
@pytest.mark.parametrize("name", PLANES)
def test_rules_along_rays(name: str, rule: RayRule, dtype: torch.dtype, of_rays: Callable[..., Tensor]) -> None:
    x, rays = rays_of(name, dtype)
    results = [found(f, x, rays, rule) for f in (of_rays, of_rays, ray_values_plain)]
    for quick, again, plain in zip(*results, strict=True):
        assert torch.equal(quick, again)
        torch.testing.assert_close(quick, plain, atol=NEAR[dtype] * 10, rtol=NEAR[dtype])


def test_rays_of_no_angle(of_rays: Callable[..., Tensor]) -> None:
    x, rays = rays_of("quarter turns", torch.float32)
    rays = replace(rays, azimuth=torch.tensor([math.nan, 1.0], device=DEVICE))
    y, by_volume, _ = found(of_rays, x, rays, "any")
    assert y[0].isnan().all() and y[1].isfinite().all() and by_volume[1].isfinite().all()


@pytest.mark.parametrize("dtype", NEAR, ids=str)
@pytest.mark.parametrize(
    ("height", "width", "bins", "channels"), [(8, 8, 8, 1), (7, 9, 13, 2), (12, 10, 5, 1), (1, 1, 3, 1)]
)
def test_line_integrals(height: int, width: int, bins: int, channels: int, dtype: torch.dtype) -> None:
    pytest.importorskip("triton")
    from unproject.ops.line_integrals_triton import project

    angle = torch.tensor([0.0, 0.4, math.pi / 2, -3.0], dtype=dtype, device=DEVICE)
    x = torch.rand(4, channels, height, width, generator=generator_at(1), dtype=dtype).to(DEVICE).requires_grad_()
    y = line_integrals.strip_integrals(x, angle, bins)
    weight = torch.rand(y.shape, generator=generator_at(2), dtype=dtype).to(DEVICE)
    (by_image,) = torch.autograd.grad(y, x, weight)
    turned, size = torch.stack(cos_sin(angle)), (height, width)
    torch.testing.assert_close(project(x.detach(), turned, size, bins, False), y.detach(), atol=NEAR[dtype], rtol=0)
    torch.testing.assert_close(project(weight, turned, size, bins, True), by_image, atol=NEAR[dtype], rtol=0)
    turned[0, 1] = math.nan
    assert project(x.detach(), turned, size, bins, False)[1].isnan().all()
