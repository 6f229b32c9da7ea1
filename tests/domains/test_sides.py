"""Sides that were seldom seen are named by their angles."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import pytest
import torch
from torch import Tensor

from unproject.domains import Images
from unproject.domains.sides import CELLS, arcs, opposite_sides_agree, seen_from, side_findings
from unproject.ops import rotate_y
from unproject.projections.base import Projection
from unproject.projections.line_integral import directions
from unproject.projections.observation import Observation
from unproject.projections.priors import Product, Uniform
from unproject.projections.silhouette import Silhouette, azimuth_bins, azimuth_elevation_bins

BINS = 12


@dataclass(frozen=True)
class Front(Projection):
    """The value at the front: nothing is seen from behind."""

    def forward(self, x: Tensor, *, azimuth: Tensor, elevation: Tensor) -> Tensor:
        return rotate_y(x, azimuth)[..., -1][:, None]


def shares(*views: int) -> Tensor:
    return torch.bincount(torch.tensor(views), minlength=BINS) / len(views)


def test_even_views_see_all_sides() -> None:
    density = seen_from(azimuth_bins(BINS), torch.full((BINS,), 1 / BINS))
    assert density.mean() == pytest.approx(1.0) and density.min() > 0.5
    (finding,) = side_findings(azimuth_bins(BINS), torch.full((BINS,), 1 / BINS), known=True)
    assert finding.word == "good" and finding.says == "all sides were seen"


def test_opposite_silhouettes_are_one_view() -> None:
    assert opposite_sides_agree(azimuth_bins(BINS)[1])
    assert opposite_sides_agree(azimuth_elevation_bins(4, 3)[0])
    assert not opposite_sides_agree(azimuth_bins(BINS, Silhouette(camera="perspective"))[1])
    assert not opposite_sides_agree(azimuth_bins(BINS, Front())[1])


def test_a_gap_is_named() -> None:
    """Views 0 to 5 are centred on 0° to 150°, so 165° to 345° were not seen; silhouettes see them from behind."""
    half = shares(0, 1, 2, 3, 4, 5)
    (finding,) = side_findings(azimuth_bins(BINS), half, known=True)
    assert finding.word == "good"
    (finding,) = side_findings(azimuth_bins(BINS, Front()), half, known=True)
    assert finding.word == "doubtful" and "from 170° to 340°" in finding.says and "up to a turn" not in finding.says
    assert finding.score.value == pytest.approx(0.5, abs=0.06)
    (finding,) = side_findings(azimuth_bins(BINS), shares(0, 0, 1, 11), known=False)
    assert finding.word == "doubtful" and finding.says.count("°") == 4 and "up to a turn" in finding.says


def test_arcs_wrap_around() -> None:
    rare = torch.zeros(CELLS, dtype=torch.bool)
    rare[[0, 1, 35, 10]] = True
    assert sorted(arcs(rare)) == [(100, 110), (350, 20)]
    assert arcs(torch.ones(CELLS, dtype=torch.bool)) == [(0, 360)] and arcs(~rare & rare) == []


def test_nothing_is_said_of_projections_without_azimuth() -> None:
    views = directions(4, 0.1)
    assert side_findings(views, torch.full((4,), 0.25), known=True) == []
    assert Images().side_findings(views, torch.full((4,), 0.25), known=True) == []
    assert Observation  # every observation has a prior with names


def test_a_rolled_camera_from_behind_is_rolled_the_other_way() -> None:
    prior = Product(Uniform("azimuth", 0, 0.4), Uniform("elevation", 0, 0), Uniform("roll", -0.3, 0.3))
    assert opposite_sides_agree(Observation("rolled", Silhouette(size=16), prior))


class Fixed(Projection):
    """A measured sensitivity of 16³ voxels."""

    example_shape: ClassVar[tuple[int, ...]] = (16, 16, 16)

    def forward(self, x: Tensor, *, azimuth: Tensor) -> Tensor:
        return rotate_y(x * torch.linspace(0.8, 1, 16), azimuth).mean(3)[:, None]


def test_projections_of_one_size_are_judged_at_that_size() -> None:
    assert not opposite_sides_agree(Observation("fixed", Fixed(), Uniform("azimuth", 0, 6)))
