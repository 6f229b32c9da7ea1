"""Slices are the volume in the planes of the columns, and rays in them are line integrals at any elevation."""

from __future__ import annotations

import math
from functools import partial

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from unproject.ops import camera_frame, orthographic_rays, sample_volume
from unproject.ops.elevation import side_slices, slice_values
from unproject.ops.resampling import centres

shapes = st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(1, 9))
sampling = st.tuples(st.integers(1, 9), st.floats(0.2, 2.5), st.integers(1, 13), st.floats(0.5, 2))
angles = st.lists(st.floats(-7, 7), min_size=1, max_size=3)


@pytest.mark.parametrize("elevation", [0.0, 0.3, -0.8, math.pi / 4, 1.2, math.pi / 2])
def test_sums_are_line_integrals(elevation: float) -> None:
    """A disc of radius r has the chord 2 sqrt(r² - v²) at any elevation, whatever the cells' height and depth."""
    h, t = centres(96, torch.empty(0))[:, None], 1.5 * centres(120, torch.empty(0))
    slices = ((0.8 - (h**2 + t**2).sqrt()) * 40 + 0.5).clamp(0, 1).T[None, :, None]
    sums = slice_values(slices, torch.tensor([elevation]), 24, 1.0, 120, 1.5, "sum")[0, :, 0] * 2 * 1.5 / 120
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
    for rule in ("samples", "sum"):
        look = partial(slice_values, size=4, viewport=1.2, samples=6, half_depth=1.5, rule=rule)
        assert torch.autograd.gradcheck(look, (x, e))
        assert torch.autograd.gradgradcheck(lambda x, f=look: f(x, e).square(), (x,))
        (slope,) = torch.autograd.grad(look(x, e).square().sum(), e, create_graph=True)
        with pytest.raises((NotImplementedError, RuntimeError), match="not implemented"):
            slope.sum().backward()
