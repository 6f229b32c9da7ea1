"""Held-out items: whole shapes, few or many, the same for the same seed."""

from __future__ import annotations

import pytest
import torch

from unproject._types import UserError
from unproject.data import Collection, with_flips


def numbered(count: int, names: list[str] | None = None) -> Collection:
    """Pictures that hold their number."""
    items = torch.arange(float(count)).view(-1, 1, 1, 1).expand(-1, 1, 2, 3) / count
    return Collection(items, names=names, latents={"azimuth": torch.arange(count)})


def shapes_of(collection: Collection) -> set[str]:
    return {name.partition("#")[0] for name in collection.names}


@pytest.mark.parametrize(
    "count, share, held", [(400, 0.1, 40), (400, 0.5, 200), (40, 0.1, 8), (12, 0.1, 3), (3, 0.1, 1)]
)
def test_a_share_of_the_shapes_is_held_out_and_none_is_in_both(count: int, share: float, held: int) -> None:
    """The names of data.observe, four images a shape."""
    found = numbered(4 * count, [f"chair_{i:05d}#{k}" for i in range(count) for k in range(4)])
    train, out = found.split(share, seed=1)
    assert len(shapes_of(out)) == held and len(out) == 4 * held and len(train) == 4 * (count - held)
    assert not shapes_of(train) & shapes_of(out)


def test_images_of_a_shape_need_not_lie_side_by_side() -> None:
    train, out = numbered(24, [f"chair_{i}#{k}" for k in range(3) for i in range(8)]).split(0.5)
    assert len(out) == 12 and not shapes_of(train) & shapes_of(out)


def test_mirror_images_stay_with_their_shape() -> None:
    names = [f"chair_{i}#{k}" for i in range(6) for k in range(2)]
    train, out = with_flips(numbered(12, names)).split(0.5)
    assert len(train) == len(out) == 12 and not shapes_of(train) & shapes_of(out)


@pytest.mark.parametrize("count, held, block", [(2000, 192, 16), (400, 40, 5), (80, 8, 1), (4, 1, 1)])
def test_without_shapes_neighbours_are_held_out_together(count: int, held: int, block: int) -> None:
    train, out = numbered(count).split(0.1)
    assert len(out) == held and len(train) + len(out) == count
    azimuth = (out.latents or {})["azimuth"]
    assert (azimuth.view(-1, block) // block == azimuth[::block, None] // block).all()


def test_a_split_is_of_the_seed_and_keeps_what_belongs_together() -> None:
    found = numbered(100)
    (a, b), (c, d), (e, f) = found.split(seed=0), found.split(seed=0), found.split(seed=1)
    assert a.names == c.names and b.names == d.names and b.names != f.names
    for part in (a, b, e, f):
        numbers = torch.tensor([int(name) for name in part.names])
        assert (numbers.diff() > 0).all()
        assert torch.equal((part.latents or {})["azimuth"], numbers.float())
        assert torch.equal(part.items[:, 0, 0, 0], numbers / 100)


@pytest.mark.parametrize("share", [0.0, 1.0, -0.1, float("nan")])
def test_a_share_is_a_part(share: float) -> None:
    with pytest.raises(UserError, match="cannot be held out; give more than 0 and less than 1"):
        numbered(9).split(share)


def test_of_one_shape_nothing_can_be_held_out() -> None:
    with pytest.raises(UserError, match="memory: shows a single shape"):
        numbered(4, [f"chair#{k}" for k in range(4)]).split()


def test_mirror_images_of_single_pictures_are_not_held_out_alone() -> None:
    train, out = with_flips(numbered(40, [f"{i:05d}" for i in range(40)])).split(0.1)
    assert len(out) and not {n.removesuffix(" flipped") for n in train.names} & {
        n.removesuffix(" flipped") for n in out.names
    }
