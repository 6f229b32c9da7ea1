"""The plane of symmetry, of shapes turned by known angles."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject.data import Collection, birds, cars, chairs, observe, plane_of_symmetry
from unproject.data.symmetry import asymmetries
from unproject.ops import framed, quarter_turn, rotate_y
from unproject.projections.silhouette import Silhouette, azimuth_bins

SIZE = 16


def boots(count: int) -> Tensor:
    """A bar along z of varied sides with a block on its back end: symmetric about x = 0 only."""
    rng, x = generator_at(3), torch.zeros(count, SIZE, SIZE, SIZE)
    for volume in x:
        length, height, width = (int(torch.randint(a, b, (), generator=rng)) for a, b in ((5, 8), (4, 7), (1, 4)))
        volume[8 - width : 8 + width, 2 : 2 + height, 8 - length : 8 + length] = 1
        volume[8 - width : 8 + width, 2 : 7 + height, 8 - length : 12 - length] = 1
    return x


SHAPES = {"boots": boots(40), "chairs": chairs(40, SIZE), "cars": cars(40, SIZE), "birds": birds(40, SIZE)}


@pytest.fixture(scope="module")
def seen() -> dict[str, Collection]:
    """Twelve silhouettes of each shape from all sides."""
    return {name: observe(x, azimuth_bins(8, Silhouette(size=SIZE)), 12) for name, x in SHAPES.items()}


def turned(collection: Collection, degrees: float, count: int, cropped: bool = False) -> Collection:
    """Some of the pictures as if the objects had been turned: it is their azimuth that differs."""
    rows = torch.randperm(len(collection), generator=generator_at(1))[:count]
    assert collection.latents is not None
    images, azimuth = collection.batch(rows), collection.latents["azimuth"][rows] + math.radians(degrees)
    return Collection(framed(images, SIZE) if cropped else images, latents={"azimuth": azimuth})


FOUND = [(0, "x"), (180, "x"), (90, "z"), (-90, "z"), (45, None), (-45, None), (22.5, None), (70, None)]


@pytest.mark.parametrize("degrees, plane", FOUND)
@pytest.mark.parametrize("name", SHAPES)
def test_the_plane_of_turned_shapes_is_found(
    seen: dict[str, Collection], name: str, degrees: float, plane: str | None
) -> None:
    assert plane_of_symmetry(turned(seen[name], degrees, 480)) == plane
    assert plane_of_symmetry(turned(seen[name], degrees, 480, cropped=True)) == plane


@pytest.mark.parametrize("degrees, plane", FOUND)
def test_twelve_pictures_of_a_view_are_enough(seen: dict[str, Collection], degrees: float, plane: str | None) -> None:
    found = [plane_of_symmetry(turned(collection, degrees, 96)) for collection in seen.values()]
    assert found == [plane] * len(found)


def test_few_pictures_tell_nothing(seen: dict[str, Collection]) -> None:
    for name in ("chairs", "cars", "birds"):
        for degrees in (0, 45):
            assert plane_of_symmetry(turned(seen[name], degrees, 10)) is None


@pytest.mark.parametrize("name", SHAPES)
def test_the_plane_of_volumes_is_found(name: str) -> None:
    x = SHAPES[name]
    aside = rotate_y(x, torch.full((len(x),), math.pi / 4))
    found = [plane_of_symmetry(Collection(volumes)) for volumes in (x, quarter_turn(x, 1), quarter_turn(x, 2), aside)]
    assert found == ["x", "z", "x", None]
    assert plane_of_symmetry(Collection(torch.rand(4, 8, 8, 8, generator=generator_at(0)) ** 3)) is None
    assert plane_of_symmetry(Collection(torch.zeros(2, 8, 8, 8))) is None


@pytest.mark.parametrize("turns, plane", [(0, "x"), (1, "z"), (2, "x"), (3, "z")])
def test_pictures_and_volumes_agree(turns: int, plane: str) -> None:
    views = azimuth_bins(8, Silhouette(size=SIZE))
    assert plane_of_symmetry(observe(quarter_turn(SHAPES["boots"], turns), views, 6)) == plane


@pytest.mark.parametrize("count", [4, 12, 16, 24, 36])
@pytest.mark.parametrize("plane, turn", [("x", 0.0), ("z", math.pi / 2)])
def test_evenly_spaced_views_are_binned_symmetrically(count: int, plane: str, turn: float) -> None:
    """Also those that lie between two bins, whatever the rounding."""
    azimuth = (2 * math.pi / count * torch.arange(count)).repeat(40)
    x = SHAPES["boots"].repeat_interleave(count, 0)
    images = Silhouette(size=SIZE)(x, azimuth=azimuth)
    found = asymmetries(images, azimuth + turn)[plane]  # type: ignore[index]
    assert abs(found.difference) < 1e-3 * found.spread
    assert plane_of_symmetry(Collection(images, latents={"azimuth": azimuth + turn})) == plane


def test_what_says_nothing_of_planes(seen: dict[str, Collection]) -> None:
    """No views, views of one side, of two opposite sides, and objects each turned differently."""
    boots = seen["boots"]
    assert boots.latents is not None
    azimuth = boots.latents["azimuth"]
    assert plane_of_symmetry(Collection(boots.items)) is None
    side = (azimuth - math.pi / 2).sin().abs() < 0.2
    assert plane_of_symmetry(boots.subset(side.nonzero()[:, 0])) is None
    anyhow = 6.3 * torch.rand(len(boots), generator=generator_at(2))
    assert plane_of_symmetry(Collection(boots.items, latents={"azimuth": anyhow})) is None


def test_expected_differences_are_those_of_noise() -> None:
    """Of pictures of noise about one mean that is its own mirror image."""
    mean = torch.rand(1, 1, 6, 3, generator=generator_at(0))
    mean = torch.cat([mean, mean.flip(-1)], -1)
    found = []
    for seed in range(20):
        rng = generator_at(seed, 1)
        images = mean + 0.1 * torch.randn(100, 1, 6, 6, generator=rng)
        found.append(torch.tensor(asymmetries(images, 6.3 * torch.rand(100, generator=rng))["z"]))
    difference, expected, spread, variance = torch.stack(found).mean(0).tolist()
    assert difference == pytest.approx(expected, rel=0.1)
    assert variance == pytest.approx(36 * 0.1**2 * 8 / 100, rel=0.1) and abs(spread) < 0.2 * variance
