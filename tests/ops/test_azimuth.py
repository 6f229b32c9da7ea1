"""The fast path is the plain reference, values and gradients, for shapes of all kinds."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from unproject.ops import camera_frame, orthographic_rays, sample_volume
from unproject.ops.azimuth import PlaneRays, ray_samples, ray_sums, resample_heights

shapes = st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(1, 9))
sampling = st.tuples(st.integers(1, 9), st.floats(0.2, 2.5), st.integers(1, 13), st.floats(0.5, 2))
extents = st.tuples(st.floats(0.5, 2), st.floats(0.5, 2))
azimuths = st.lists(st.floats(-7, 7), min_size=1, max_size=3)


def rays_of(
    shape: tuple[int, int, int],
    sampling: tuple[int, float, int, float],
    azimuth: list[float],
    extent: tuple[float, float] = (1.0, 1.0),
) -> PlaneRays:
    return PlaneRays(torch.tensor(azimuth, dtype=torch.float64), (shape[0], shape[2]), *sampling, extent)


def dense(gather, rows: int, columns: int) -> torch.Tensor:  # noqa: ANN001
    matrix = torch.zeros(rows, columns, dtype=torch.float64)
    row = torch.arange(rows)[:, None].expand_as(gather.index)
    return matrix.index_put((row, gather.index), gather.weight, accumulate=True)


@settings(deadline=None, max_examples=60)
@given(shapes, sampling, azimuths, extents)
def test_the_adjoint_is_the_transpose(shape, sampling, azimuth, extent) -> None:  # noqa: ANN001
    rays = rays_of(shape, sampling, azimuth, extent)
    samples, places = len(azimuth) * rays.size * rays.samples, len(azimuth) * shape[0] * shape[2]
    A = dense(rays.forward(), samples, places)
    torch.testing.assert_close(dense(rays.adjoint(), places, samples), A.T, atol=1e-9, rtol=0)


@settings(deadline=None, max_examples=40)
@given(shapes, sampling, azimuths)
def test_samples_and_sums_equal_trilinear_resampling(shape, sampling, azimuth) -> None:  # noqa: ANN001
    size, viewport, samples, half_depth = sampling
    rays = rays_of(shape, sampling, azimuth)
    x = torch.rand(len(azimuth), *shape, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    points = orthographic_rays(camera_frame(rays.azimuth), size, viewport, samples, half_depth)
    expected = sample_volume(x, points).flip(1).permute(0, 2, 3, 1)
    resampled = resample_heights(x, size, viewport)
    torch.testing.assert_close(ray_samples(resampled, rays), expected, atol=1e-9, rtol=0)
    torch.testing.assert_close(ray_sums(resampled, rays), expected.sum(2), atol=1e-9, rtol=0)


def test_differentiable_twice() -> None:
    rays = rays_of((3, 2, 4), (3, 1.2, 4, 1.5), [0.4, 2.0])
    x = torch.rand(2, 3, 2, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0), requires_grad=True)
    for operator in (ray_samples, ray_sums):
        assert torch.autograd.gradcheck(lambda v, f=operator: f(v, rays), (x,))
        assert torch.autograd.gradgradcheck(lambda v, f=operator: f(v, rays).square(), (x,))


@pytest.mark.parametrize("spoilt", ["azimuth", "viewport", "offset"])
def test_a_view_that_has_broken_down_is_nan_there_and_back(spoilt: str) -> None:
    """By the plain path, which GPUs take: an index that is none would end the process there."""
    views = {"azimuth": torch.tensor([0.3, 0.3]), "viewport": torch.ones(2), "offset": torch.zeros(2)}
    views[spoilt][1] = math.nan
    volume = torch.rand(2, 4, 4, 4, requires_grad=True)
    rays = PlaneRays(views["azimuth"], (4, 4), 4, views["viewport"], 4, 1.0, offset=views["offset"])
    y = ray_samples(volume, rays)
    assert y[1].isnan().all() and y[0].isfinite().all()
    y.sum().backward()
    assert volume.grad is not None and volume.grad[0].isfinite().all() and volume.grad[1].isnan().any()
