"""Round feet: of cylinders and discs seen from above, not of boxes, legs and bellies, nor from level."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.nn.functional import avg_pool2d, pad

from unproject.ops import round_feet
from unproject.projections.silhouette import Silhouette

N = 64
X, Y, Z = torch.meshgrid(*[torch.arange(N) - N / 2 + 0.5] * 3, indexing="ij")
RADIUS = (X.square() + Z.square()).sqrt()


def between(low: float, high: float) -> Tensor:
    return (low <= Y) & (high >= Y)


TAPER = (1 - X / 40).clamp(0.3, 1)
BODIES = {
    "cylinder": (RADIUS < 12) & between(-20, 16),
    "lamp": ((RADIUS < 9) & between(-20, -16)) | ((RADIUS < 2) & between(-16, 8)) | ((RADIUS < 14) & between(8, 20)),
    "cup with a handle": ((RADIUS < 12) & between(-16, 14)) | ((Z.abs() < 2) & (X > 0) & (X < 18) & between(-2, 6)),
    "ball": X.square() + Y.square() + Z.square() < 17**2,
    "ovoid": (X / 24).square() + (Y / 12).square() + (Z / 9).square() < 1,
    "tub": ((X / 26) ** 4 + ((Y - 8) / 16) ** 4 + (Z / 10) ** 4 < 1) & (Y < 8),
    "box": (X.abs() < 14) & (Z.abs() < 9) & between(-16, 14),
    "cube": (X.abs() < 12) & (Z.abs() < 12) & between(-14, 10),
    "table": ((X.abs() < 14) & (Z.abs() < 11) & between(8, 12))
    | (((X.abs() - 12).abs() < 2) & ((Z.abs() - 9).abs() < 2) & between(-18, 8)),
    "stick": (RADIUS < 4.5) & between(-29, 29),
    "fish": (X / 24 - 0.1).square() + (Y / 8 - X.square() / 320).square() + (Z / 6).square() < TAPER,
}  # fmt: skip
ROUND = ("cylinder", "lamp", "cup with a handle")


def seen(body: Tensor, elevation: float, size: int = N, count: int = 24) -> Tensor:
    azimuth = torch.arange(count) / count * 2 * math.pi + 0.1
    x = body.float()[None].expand(count, -1, -1, -1)
    fine = Silhouette(size=N)(x, azimuth=azimuth, elevation=torch.full((count,), math.radians(elevation)))
    return avg_pool2d((fine > 0.5).float(), N // size)


@pytest.mark.parametrize("elevation", [22, 25])
@pytest.mark.parametrize("name", list(BODIES))
def test_what_stands_on_a_disc_has_a_round_foot(name: str, elevation: float) -> None:
    share = round_feet(seen(BODIES[name], elevation))
    assert share > 0.7 if name in ROUND else share < 0.3


@pytest.mark.parametrize("name", list(BODIES))
def test_level_cameras_see_no_round_foot(name: str) -> None:
    assert round_feet(seen(BODIES[name], 0)) < 0.4


@pytest.mark.parametrize("radius", [2, 3, 4, 5])
def test_boxes_with_rounded_edges_have_none(radius: int) -> None:
    beyond = torch.stack([(X.abs() - 16), (Y.abs() - 15), (Z.abs() - 12)]) + radius
    box = beyond.clamp_min(0).square().sum(0) < radius**2
    assert round_feet(seen(box, 0)) < 0.3


def test_place_and_side_do_not_matter() -> None:
    pictures = torch.cat([seen(BODIES["cylinder"], 22), seen(BODIES["box"], 22)])
    share = round_feet(pictures)
    assert 0.4 < share < 0.6
    for same in (pictures.flip(3), pictures.flip(0), pad(pictures, (4, 9, 1, 6)), pictures.repeat(2, 1, 1, 1)):
        assert round_feet(same) == pytest.approx(share, abs=0.03)


def test_half_as_many_pixels_do_for_wide_feet() -> None:
    assert round_feet(seen(BODIES["cylinder"], 25, size=32)) > 0.7
    assert round_feet(seen(BODIES["box"], 25, size=32)) < 0.3


@pytest.mark.parametrize("elevation", [3, 5, 8])
def test_a_corner_that_is_seen_from_low_is_not_round(elevation: float) -> None:
    assert all(round_feet(seen(BODIES[name], elevation)) < 0.2 for name in ("box", "cube"))


def test_a_foot_that_is_hollow_is_not_round() -> None:
    row, column = torch.meshgrid(torch.arange(N) - 31.5, torch.arange(N) - 31.5, indexing="ij")
    arc = 6 * (1 - (column / 14).square()).clamp_min(0).sqrt()
    cup, arch = ((column.abs() < 14) & (row > -24) & (row < low) for low in (20 + arc, 26 - arc))
    assert round_feet(cup[None, None].float()) == 1.0 and round_feet(arch[None, None].float()) == 0.0


def test_the_end_of_a_stick_tells_nothing() -> None:
    row, column = torch.meshgrid(torch.arange(N) - 31.5, torch.arange(N) - 31.5, indexing="ij")
    found = []
    for half in (5, 12):
        low = 24 + 5 * (1 - (column / half).square()).clamp_min(0).sqrt()
        covered = (low - row + 0.5).clamp(0, 1) * (column.abs() < half) * (row > -30)
        found.append(round_feet(covered[None, None]))
    assert found == [0.0, 1.0]


def test_empty_pictures_do_not_count() -> None:
    pictures = torch.cat([seen(BODIES["cylinder"], 20), torch.zeros(50, 1, N, N)])
    assert round_feet(pictures) > 0.7 and round_feet(torch.zeros(3, 1, N, N)) == 0.0
