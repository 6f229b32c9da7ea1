"""Level outlines: high from level cameras, lower the higher they stand, of any size, side and place."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from unproject.data import chairs
from unproject.ops import level_share, mirror_iou
from unproject.projections.silhouette import Silhouette


@pytest.fixture(scope="module")
def furniture() -> Tensor:
    """Boxes that stand on legs or on the ground, some with a back."""
    return chairs(60, 64, seed=3)


def seen(x: Tensor, elevation: float, size: int = 64, roll: float = 0.0) -> Tensor:
    azimuth = torch.rand(len(x), generator=torch.Generator().manual_seed(1)) * 2 * math.pi
    angles = {"elevation": torch.full((len(x),), elevation), "roll": torch.full((len(x),), roll)}
    fine = (Silhouette(size=64)(x, azimuth=azimuth, **angles) > 0.5).float()
    return avg_pool2d(fine, 64 // size)


@pytest.mark.parametrize("size", [32, 64])
def test_it_falls_with_the_elevation(furniture: Tensor, size: int) -> None:
    shares = [level_share(seen(furniture, math.radians(e), size)) for e in (0, 5, 10, 20, 30)]
    assert shares == sorted(shares, reverse=True)
    assert shares[0] > 0.6 and shares[2] < 0.4 and shares[4] < 0.25


def test_it_falls_with_roll(furniture: Tensor) -> None:
    assert level_share(seen(furniture, 0.0, roll=0.1)) < level_share(seen(furniture, 0.0)) / 2


def test_both_outlines_of_all_pictures_count_alike(furniture: Tensor) -> None:
    pictures = seen(furniture, 0.2)
    share = level_share(pictures)
    for same in (pictures.flip(2), pictures.flip(3), pictures.flip(0), pad(pictures, (2, 2, 4, 0))[..., 2:-2]):
        assert level_share(same) == pytest.approx(share, abs=1e-9)
    assert level_share(torch.cat([pictures, pictures])) == pytest.approx(share)


def test_edges_between_pixels_are_where_coverage_tells() -> None:
    """Slopes of pictures that are covered by area, of which whole pixels would make steps."""
    row, column = torch.meshgrid(torch.arange(64.0), torch.arange(64.0), indexing="ij")
    for run, share in ((8, 0.5), (20, 1.0)):
        slope = (row - 10 - column / run).clamp(0, 1)[None, None]
        assert level_share(slope) == pytest.approx(share, abs=0.02), "the lower outline is level"


def test_parts_apart_are_no_slope() -> None:
    """Two legs of different lengths: the step between them is no piece of an outline."""
    legs = torch.zeros(1, 1, 32, 32)
    legs[..., 4:10, 2:30], legs[..., 10:13, 2:16] = 1, 1
    assert level_share(legs) == 1


@pytest.mark.parametrize(
    "empty",
    [
        torch.zeros(2, 1, 16, 16),
        torch.zeros(1, 1, 16, 16).index_fill(3, torch.tensor(3), 1.0),
        torch.ones(1, 1, 3, 3),  # narrower than what counts as a straight piece
    ],
)
def test_silhouettes_without_outlines_show_nothing(empty: Tensor) -> None:
    assert level_share(empty) == 0


# Mirror images


def test_a_symmetric_silhouette_is_its_own_mirror_image_wherever_it_is() -> None:
    disc = torch.zeros(2, 1, 32, 32)
    row, column = torch.meshgrid(torch.arange(32), torch.arange(32), indexing="ij")
    disc[0, 0] = ((row - 9.5).square() + (column - 7.5).square() < 36).float()
    disc[1, 0] = ((row - 20.0).square() + (column - 23.0).square() < 50).float()
    assert mirror_iou(disc).tolist() == [1.0, 1.0]


def test_a_wedge_shares_a_third_with_its_mirror_image() -> None:
    row, column = torch.meshgrid(torch.arange(60), torch.arange(60), indexing="ij")
    wedge = (column <= row).float()[None, None]
    for same in (wedge, wedge.flip(3), wedge.flip(2), pad(wedge, (5, 0, 0, 3))):
        assert mirror_iou(same).item() == pytest.approx(1 / 3, abs=0.02)
    assert mirror_iou(torch.zeros(1, 1, 8, 8)).item() == 0.0


def test_boxes_are_their_own_mirror_images_from_level_only() -> None:
    box = torch.zeros(16, 32, 32, 32)
    box[:, 6:26, 4:24, 11:21] = 1
    azimuth = torch.arange(16) / 16 * 2 * math.pi + 0.1
    level, tilted = (Silhouette(size=32)(box, azimuth=azimuth, elevation=torch.full((16,), e)) for e in (0.0, 0.5))
    assert mirror_iou(level).median() > 0.9 > mirror_iou(tilted).median()
