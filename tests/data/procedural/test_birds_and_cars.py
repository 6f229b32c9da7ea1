"""Procedural data sets of birds and cars, and the solids they are made of."""

from __future__ import annotations

import math

import pytest
import torch

from unproject._types import UserError
from unproject.data import birds, cars
from unproject.data.procedural.shapes.solids import Grid, ProceduralShapes

DATA_SETS = pytest.mark.parametrize("make", [birds, cars], ids=["birds", "cars"])


@DATA_SETS
def test_shapes_are_whole_and_inside_the_frame(make: ProceduralShapes) -> None:
    x = make(40, 32)
    assert x.shape == (40, 32, 32, 32) and set(x.unique().tolist()) == {0.0, 1.0}
    assert torch.equal(x, x.flip(1))  # mirror images of themselves
    border = [x[:, [0, -1]], x[:, :, [0, -1]], x[..., [0, -1]]]
    assert not any(part.any() for part in border)
    assert x.flatten(1).mean(1).min() > 0.008 and x.flatten(1).mean(1).max() < 0.2


@DATA_SETS
def test_a_shape_depends_on_its_seed_and_index_alone(make: ProceduralShapes) -> None:
    x = make(5, 16)
    assert torch.equal(x, make(9, 16, chunk=2)[:5]) and not torch.equal(x, make(5, 16, seed=1))
    assert torch.pdist(x.flatten(1)).min() > 3


@DATA_SETS
def test_hard_shapes_are_soft_ones_cut_at_one_half(make: ProceduralShapes) -> None:
    soft = make(3, 16, soft=True)
    assert torch.equal(make(3, 16), (soft > 0.5).float()) and soft[(soft > 0) & (soft < 1)].numel() > 0


@DATA_SETS
def test_they_face_the_front(make: ProceduralShapes) -> None:
    """Beaks and bonnets at +z are low and narrow: less there than at the same distance behind, or higher up."""
    x = make(60, 32).mean(0)
    along = x.sum((0, 1))
    if make is birds:  # heads in front are higher than tails behind
        height = torch.arange(32.0)
        front, behind = (x[..., part].sum((0, 2)) for part in (slice(24, 32), slice(0, 8)))
        assert (front * height).sum() / front.sum() > (behind * height).sum() / behind.sum() + 4
    else:  # bonnets are longer than boots
        assert along[22:27].sum() < along[5:10].sum()


@DATA_SETS
def test_what_cannot_be_made_is_refused(make: ProceduralShapes) -> None:
    with pytest.raises(UserError, match="count of 1 or more"):
        make(0)
    with pytest.raises(UserError, match="resolution of 8"):
        make(1, 4)


def test_solids_have_their_volumes() -> None:
    grid = Grid.of(64)
    voxel = grid.cell**3
    ball = grid.ellipsoid((0.0, 0.1, -0.1), (0.5, 0.5, 0.5)).sum().item() * voxel
    assert ball == pytest.approx(4 / 3 * math.pi * 0.5**3, rel=0.01)
    egg = grid.ellipsoid((0.0, 0.0, 0.0), (0.3, 0.4, 0.6), 0.7).sum().item() * voxel
    assert egg == pytest.approx(4 / 3 * math.pi * 0.3 * 0.4 * 0.6, rel=0.02)
    rod = grid.rod((0.0, -0.5, 0.0), (0.0, 0.5, 0.0), 0.2).sum().item() * voxel
    assert rod == pytest.approx(math.pi * 0.2**2 * 1.0 + 4 / 3 * math.pi * 0.2**3, rel=0.02)
    box = grid.box((0.0, 0.0, 0.0), (0.4, 0.3, 0.5), (0.5, 0.0)).sum().item() * voxel
    assert box == pytest.approx(0.8 * 0.6 * (1.0 - 0.5 * 0.3), rel=0.02)
    # x is |x|: a wheel stands for a pair.
    wheels = grid.wheel((0.6, 0.0, 0.0), 0.4, 0.1).sum().item() * voxel
    assert wheels == pytest.approx(2 * math.pi * 0.4**2 * 0.2, rel=0.02)


def test_pitch_lifts_the_front() -> None:
    grid = Grid.of(32)
    x = grid.ellipsoid((0.0, 0.0, 0.0), (0.2, 0.2, 0.8), 0.5)
    height = grid.y[:, 0]
    assert (x[..., 24:].sum((0, 2)) * height).sum() > 0 > (x[..., :8].sum((0, 2)) * height).sum()
