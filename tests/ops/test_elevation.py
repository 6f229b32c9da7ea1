"""Slices are the volume in the planes of the columns, sums of rays in them are Joseph's, adjoints are transposes."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from unproject.ops import camera_frame, orthographic_rays, sample_volume
from unproject.ops.azimuth import Gather
from unproject.ops.elevation import SliceLines, side_slices, slice_samples, slice_sums
from unproject.ops.resampling import centres

shapes = st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(1, 9))
sampling = st.tuples(st.integers(1, 9), st.floats(0.2, 2.5), st.integers(1, 13), st.floats(0.5, 2))
angles = st.lists(st.floats(-7, 7), min_size=1, max_size=3)


def dense(gather: Gather, rows: int, columns: int) -> torch.Tensor:
    matrix = torch.zeros(rows, columns, dtype=torch.float64)
    row = torch.arange(rows)[:, None].expand_as(gather.index)
    return matrix.index_put((row, gather.index), gather.weight, accumulate=True)


@settings(deadline=None, max_examples=60)
@given(
    st.tuples(st.integers(1, 9), st.integers(1, 9)), st.integers(1, 9), st.floats(0.2, 2.5), st.floats(0.5, 2), angles
)
def test_weights_fall_with_the_distance_from_the_ray(plane, size, viewport, half_depth, angle) -> None:  # noqa: ANN001
    """Both the matrix and its transpose, from the formula of the module."""
    e = torch.tensor(angle, dtype=torch.float64)
    lines = SliceLines(e, plane, size, viewport, half_depth)
    c, s = e.cos()[:, None, None, None], e.sin()[:, None, None, None]
    h, t = centres(plane[1], e)[:, None], -half_depth * centres(plane[0], e)
    m = torch.maximum(c.abs() * 2 / plane[1], s.abs() * 2 * half_depth / plane[0])
    weight = (1 - ((h * c - t * s - viewport * centres(size, e)[:, None, None]) / m).abs()).clamp(min=0)
    cells = len(e) * plane[0] * plane[1]
    expected = torch.einsum("bjyt,ba->bjyat", weight, torch.eye(len(e)).double()).reshape(len(e) * size, cells)
    torch.testing.assert_close(dense(lines.forward(), len(e) * size, cells), expected, atol=1e-8, rtol=0)
    torch.testing.assert_close(dense(lines.adjoint(), cells, len(e) * size), expected.T, atol=1e-8, rtol=0)


@pytest.mark.parametrize("elevation", [0.0, 0.3, -0.8, math.pi / 4, 1.2, math.pi / 2])
def test_sums_are_line_integrals(elevation: float) -> None:
    """A disc of radius r has the chord 2 sqrt(r² - v²) at any elevation, whatever the cells' height and depth."""
    h, t = centres(96, torch.empty(0))[:, None], 1.5 * centres(120, torch.empty(0))
    slices = ((0.8 - (h**2 + t**2).sqrt()) * 40 + 0.5).clamp(0, 1).T[None, :, None]
    sums = slice_sums(slices, torch.tensor([elevation]), 24, 1.0, 1.5)[0, :, 0] * 2 * 1.5 / 120
    chord = 2 * (0.8**2 - centres(24, sums) ** 2).clamp(min=0).sqrt()
    assert (sums - chord).abs().mean() < 0.01 and (sums - chord).abs().max() < 0.06


@settings(deadline=None, max_examples=40)
@given(shapes, sampling, angles)
def test_side_slices_are_the_volume_in_the_planes_of_the_columns(shape, sampling, azimuth) -> None:  # noqa: ANN001
    size, viewport, depths, half_depth = sampling
    a = torch.tensor(azimuth, dtype=torch.float64)
    x = torch.rand(len(a), *shape, dtype=torch.float64, generator=torch.Generator().manual_seed(0))
    points = orthographic_rays(camera_frame(a), size, viewport, depths, half_depth)[:, 0].clone()
    points = points[:, :, :, None].repeat(1, 1, 1, shape[1], 1)
    points[..., 1] = centres(shape[1], x)
    expected = sample_volume(x, points).transpose(1, 2).flip(2)
    torch.testing.assert_close(side_slices(x, a, size, viewport, depths, half_depth), expected, atol=1e-9, rtol=0)


def test_differentiable_in_elevation_once_and_in_the_volume_twice() -> None:
    x = torch.rand(2, 5, 3, 4, dtype=torch.float64, generator=torch.Generator().manual_seed(0), requires_grad=True)
    e = torch.tensor([0.4, -1.1], dtype=torch.float64, requires_grad=True)
    for look in (lambda x, e: slice_samples(x, e, 4, 1.2, 6, 1.5), lambda x, e: slice_sums(x, e, 4, 1.2, 1.5)):
        assert torch.autograd.gradcheck(look, (x, e))
        assert torch.autograd.gradgradcheck(lambda x, f=look: f(x, e).square(), (x,))
        (slope,) = torch.autograd.grad(look(x, e).square().sum(), e, create_graph=True)
        with pytest.raises(RuntimeError, match="not implemented"):
            slope.sum().backward()
