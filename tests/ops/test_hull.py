"""Visual hulls: larger, idempotent, the same silhouettes, and hollows filled."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from unproject._types import UserError
from unproject.ops import visual_hull
from unproject.ops.resampling import centres


def grid(size: int) -> tuple[torch.Tensor, ...]:
    return torch.meshgrid(*[centres(size, torch.empty(0))] * 3, indexing="ij")


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 1000), st.tuples(*[st.integers(1, 9)] * 3), st.integers(1, 16), st.booleans())
def test_larger_idempotent_and_monotone(seed: int, shape: tuple[int, int, int], views: int, soft: bool) -> None:
    x = torch.rand(2, *shape, generator=torch.Generator().manual_seed(seed)) ** 4
    x = x if soft else (x > 0.5).float()
    hull = visual_hull(x, views)
    assert (hull >= x).all() and (hull <= x.amax((1, 2, 3), keepdim=True)).all()
    assert torch.equal(visual_hull(hull, views), hull)
    assert (visual_hull(x / 2, views) <= hull).all()
    # Level sets: thresholding and hull commute.
    assert torch.equal(visual_hull((x > 0.3).float(), views), (hull > 0.3).float())


def test_a_ball_stays_within_a_voxel() -> None:
    x, y, z = grid(24)
    radius = (x**2 + y**2 + z**2).sqrt()
    hull = visual_hull((radius < 0.8).float()[None])[0]
    assert (hull[radius < 0.8] == 1).all() and (hull[radius > 0.8 + 2 / 24] == 0).all()


def test_a_hollow_box_becomes_solid() -> None:
    box = torch.zeros(1, 16, 16, 16)
    box[:, 3:13, 3:13, 3:13] = 1
    hollow = box.clone()
    hollow[:, 5:11, 5:11, 5:11] = 0
    assert torch.equal(visual_hull(hollow), visual_hull(box))
    assert (visual_hull(box) - box).sum() < 0.02 * box.sum()


def test_a_gap_that_a_view_sees_through_stays_open() -> None:
    """A table: between the legs one sees through."""
    table = torch.zeros(1, 16, 16, 16)
    table[:, 2:14, 10:12, 2:14] = 1
    for i in (2, 12):
        for k in (2, 12):
            table[:, i : i + 2, :10, k : k + 2] = 1
    hull = visual_hull(table)
    assert hull[0, 8, 5, 8] == 0 and hull[0, 8, 5, 4] == 0


def test_fog_becomes_the_body_that_it_looks_like() -> None:
    """A box of fog that no ray sees through: as opaque as its silhouettes, larger by a voxel's corners at most."""
    box = torch.zeros(1, 24, 24, 24)
    box[:, 4:20, 6:18, 4:20] = 1
    hull = visual_hull(0.1 * box, density=2.0)
    assert (visual_hull(0.1 * box) <= 0.1).all()
    middle = hull[:, 11:13, 6:18, 11:13]
    torch.testing.assert_close(middle.amin(), 1 - torch.exp(torch.tensor(-2 * 0.1 * 16)), atol=0.02, rtol=0)
    assert ((hull > 0.5) & (box == 0)).sum() < 0.05 * box.sum()


def test_mist_stays_mist() -> None:
    """Each ray of it absorbs 2 %; a hull of which each voxel did so would look like a body."""
    x = torch.full((1, 32, 32, 32), 3e-4)
    x[:, 8:24, 8:24, 8:24] = 1
    hull = visual_hull(x, density=2.0)
    seen = -torch.expm1(-2.0 * hull.sum(3))
    assert seen[:, 8:24, 8:24].min() > 0.99 and seen[:, :, :6].max() < 0.05
    assert ((hull > 0.5) == (x > 0.5)).float().mean() > 0.99


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 1000), st.floats(0.5, 4.0))
def test_by_absorption_it_is_larger_and_grows_with_the_density(seed: int, density: float) -> None:
    x = torch.rand(2, 7, 6, 7, generator=torch.Generator().manual_seed(seed)) ** 4
    hull = visual_hull(x, 8, density)
    assert (hull >= x).all() and (visual_hull(x, 8, 2 * density) >= hull).all() and hull.amax() <= 1


def test_differentiable() -> None:
    x = torch.rand(1, 5, 4, 5, dtype=torch.float64, generator=torch.Generator().manual_seed(0), requires_grad=True)
    assert torch.autograd.gradcheck(visual_hull, (x,))


@pytest.mark.parametrize("angle", [0.1, math.pi / 4])
def test_a_bar_off_the_axes_stays_a_bar(angle: float) -> None:
    x, y, z = grid(32)
    across = (x * math.cos(angle) - z * math.sin(angle)).abs()
    along = (x * math.sin(angle) + z * math.cos(angle)).abs()
    bar = ((across < 0.15) & (along < 0.8) & (y.abs() < 0.5)).float()[None]
    assert visual_hull(bar).sum() < 1.5 * bar.sum()


def test_no_view_is_refused() -> None:
    with pytest.raises(UserError, match="views=0"):
        visual_hull(torch.ones(1, 4, 4, 4), views=0)
