"""Thin parts: the level at which pictures show them, and pictures in which that level is one half."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d

from unproject.ops import level_of_thin_parts, with_thin_parts

FINE, SIDE = 320, 32


def stools(width: float, gap: float = 0.0) -> Tensor:
    """Twenty stools whose legs are so many coarse pixels wide, each at another place; `gap` between seat and legs."""
    cell = FINE // SIDE
    fine = torch.zeros(20, 1, FINE, FINE)
    for k, picture in enumerate(fine[:, 0]):
        picture[40 + k : 120 + k, 40:280] = 1
        for left in (60 + 3 * k, 190 + k):
            picture[120 + k + round(gap * cell) : 270, left : left + round(width * cell)] = 1
    return avg_pool2d(fine, cell)


def in_half(width: float) -> float:
    return level_of_thin_parts(stools(width))


def test_thick_parts_need_no_other_level() -> None:
    assert in_half(1.2) == in_half(3.0) == 0.5


def test_thin_legs_are_shown_where_half_of_a_pixel_hides_them() -> None:
    """A leg of width w between two pixels covers w / 2 of each; 0.25 is the lowest level."""
    assert [in_half(width) for width in (0.8, 0.6)] == [0.4, 0.3] and in_half(0.3) == 0.25


def test_legs_that_are_gone_are_missed_though_what_is_left_is_in_one_piece() -> None:
    y = stools(0.7)
    gone = y * (y > 0.5)
    assert (gone[:, :, -8:] == 0).all(1).any() and level_of_thin_parts(y) < 0.5


def test_a_leg_that_is_thin_in_one_place_is_in_pieces() -> None:
    y = stools(1.0)[:1]
    y[..., 20, :] *= 0.35
    assert level_of_thin_parts(y) == 0.35


def test_gaps_of_the_object_itself_are_no_matter() -> None:
    assert level_of_thin_parts(stools(1.2, gap=3.0)) == 0.5


def test_few_pictures_with_thin_parts_do_not_decide() -> None:
    thick, thin = stools(1.2), stools(0.3)
    assert level_of_thin_parts(torch.cat([thick, thin[:1]])) == 0.5
    assert level_of_thin_parts(torch.cat([thick, thin[:4]])) < 0.5


def test_empty_pictures_say_nothing() -> None:
    assert level_of_thin_parts(torch.zeros(3, 1, 8, 8)) == 0.5 == level_of_thin_parts(torch.zeros(0, 1, 8, 8))


@pytest.mark.parametrize("level", [0.25, 0.3, 0.4])
def test_the_level_becomes_one_half(level: float) -> None:
    y = torch.zeros(102, 1, 3, 3)
    y[:, 0, 1, 1] = torch.cat([torch.linspace(0, 1, 101), torch.tensor([level])])  # a dot each
    *shown, half = with_thin_parts(y, level)[:, 0, 1, 1].tolist()
    assert shown[0] == 0 and shown[-1] == 1 and shown == sorted(set(shown)) and half == pytest.approx(0.5)
    assert with_thin_parts(y, 0.5) is y


def test_a_leg_of_two_pixels_gets_its_soft_rims() -> None:
    """Of one or two pixels at ½ legs are hard to make; of three they are thick."""
    y = torch.zeros(2, 1, 9, 9)
    y[0, ..., 3:7] = torch.tensor([0.3, 1.0, 1.0, 0.3])
    y[1, ..., 2:7] = torch.tensor([0.3, 1.0, 1.0, 1.0, 0.3])
    raised = with_thin_parts(y, 0.25)
    assert (raised[0, ..., 3:7] > 0.5).all() and torch.equal(raised[1], y[1])


def test_thick_parts_stay_as_they_are() -> None:
    """A disc with a soft rim, of 9 pixels; beside it a wire, which alone changes."""
    grid = torch.arange(SIDE) - 10.0
    disc = (5 - (grid[:, None].square() + grid.square()).sqrt()).clamp(0, 1)[None, None]
    y = disc.clone()
    y[..., 26] = 0.3
    raised = with_thin_parts(y, 0.25)
    assert torch.equal(raised[..., :24], disc[..., :24]) and (raised[..., 26] > 0.5).all()
    assert (raised[..., 24:26] == 0).all() and (raised[..., 27:] == 0).all()


@pytest.mark.parametrize("width", [0.8, 0.6])
def test_such_pictures_show_their_thin_parts_at_one_half(width: float) -> None:
    y = stools(width)
    assert level_of_thin_parts(with_thin_parts(y, level_of_thin_parts(y))) == 0.5
