"""Parts of volumes against a plain reference, and what must stay: thin legs, soft rims, the surface."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from math import inf

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from unproject._types import UserError
from unproject.ops import face_connected, floating_parts, joined_parts, largest_part
from unproject.ops.isosurface import isosurface
from unproject.ops.parts import number_parts

Voxel = tuple[int, ...]


def drawn(seed: int, shape: tuple[int, ...], fullness: float) -> Tensor:
    """Noise of which a share is above one half."""
    noise = torch.rand(3, *shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return (noise * 0.5 / (1 - fullness)).clamp(max=1)


volumes = st.builds(
    drawn, st.integers(0, 10_000), st.tuples(*[st.integers(1, 7)] * 3), st.sampled_from([0.02, 0.05, 0.1, 0.4])
)


# The reference


def distance(a: Voxel, others: set[Voxel]) -> int:
    """The chessboard distance of a voxel to a set of them."""
    return min(max(abs(i - j) for i, j in zip(a, b, strict=True)) for b in others)


def groups(voxels: list[Voxel], reach: int) -> list[set[Voxel]]:
    """Sets of voxels linked by steps of at most `reach`, in the order of their first voxels."""
    left, found = list(voxels), list[set[Voxel]]()
    while left:
        group, edge = set[Voxel](), [left[0]]
        while edge:
            group |= set(edge)
            left = [v for v in left if v not in group]
            edge = [v for v in left if distance(v, set(edge)) <= reach]
        found.append(group)
    return found


def above(x: Tensor) -> list[Voxel]:
    return [tuple(v) for v in (x > 0.5).nonzero().tolist()]


def parts_of(x: Tensor) -> tuple[set[Voxel], set[Voxel]]:
    """The largest part, and all the others."""
    parts = groups(above(x), 1)
    largest = max(parts, key=len)
    return largest, set(above(x)) - largest


def everywhere(x: Tensor) -> list[Voxel]:
    return list(product(*map(range, x.shape)))


@settings(deadline=None, max_examples=40)
@given(volumes)
def test_the_largest_part_is_the_references(x: Tensor) -> None:
    for volume, found in zip(x, largest_part(x), strict=True):
        wanted = volume.clone()
        if len(groups(above(volume), 1)) > 1:
            largest, others = parts_of(volume)
            for v in everywhere(volume):
                wanted[v] *= distance(v, largest) <= distance(v, others)
        assert torch.equal(found, wanted)


@settings(deadline=None, max_examples=40)
@given(volumes)
def test_floating_parts_and_gaps_are_the_references(x: Tensor) -> None:
    for volume, floating, gaps in zip(x, *floating_parts(x), strict=True):
        if len(groups(above(volume), 1)) < 2:
            assert not floating.any() and not gaps.any()
            continue
        largest, others = parts_of(volume)
        far = set().union(*(group for group in groups(above(volume), 3) if not group & largest))
        for v in everywhere(volume):
            inside = v in largest | others
            assert floating[v] == (bool(far) and distance(v, far) <= 1)
            assert gaps[v] == (not inside and distance(v, largest) + distance(v, others) <= 3)


def adjoin(a: Voxel, b: Voxel) -> bool:
    return distance(a, {b}) == 1


def touch(a: Voxel, b: Voxel) -> bool:
    return sum(abs(i - j) for i, j in zip(a, b, strict=True)) == 1


def costs_from(
    start: set[Voxel], cost: dict[Voxel, float], adjoin: Callable[[Voxel, Voxel], bool] = adjoin
) -> dict[Voxel, float]:
    """The least sum of costs of the voxels on a path, its last included, to each voxel that can be reached."""
    found, edge = dict.fromkeys(start, 0.0), start
    while edge:
        reached = dict(found)
        for v in edge:
            for w in (w for w in cost if adjoin(v, w)):
                reached[w] = min(reached.get(w, inf), found[v] + cost[w])
        edge = {v for v in reached if reached[v] < found.get(v, inf)}
        found = reached
    return found


def joined(volume: Tensor, low: float = 0.02, gap: int = 4) -> Tensor:
    """What `joined_parts` is to return: all paths of least cost to other parts are raised, until all others are far."""
    volume = volume.clone()
    while True:
        parts = groups(above(volume), 1)
        largest = max(parts, key=len, default=set[Voxel]())
        cost = {v: 2 - volume[v].item() for v in everywhere(volume) if volume[v] > low} | dict.fromkeys(largest, 0.0)
        there, raised = costs_from(largest, cost), set[Voxel]()
        for part in (part for part in parts if part != largest):
            least = min(there.get(v, inf) - cost[v] for v in part)
            if least <= 2 * min(gap, len(part)):
                back = costs_from(part, cost)
                raised |= {v for v in there if there[v] + back[v] - cost[v] <= least + 1e-5}
        raised -= set(above(volume))
        if not raised:
            return volume
        for v in raised:
            volume[v] = 0.75


@settings(deadline=None, max_examples=20)
@given(volumes)
def test_joined_parts_are_the_references(x: Tensor) -> None:
    for low in (0.02, 0.4):
        for volume, found in zip(x, joined_parts(x, low=low), strict=True):
            assert torch.equal(found, joined(volume, low))


def pieces_of(part: set[Voxel]) -> list[set[Voxel]]:
    """Its pieces that are connected by faces, in the order of their first voxels."""
    left, found = sorted(part), list[set[Voxel]]()
    while left:
        piece, edge = set[Voxel](), {left[0]}
        while edge:
            piece |= edge
            edge = {v for v in left if v not in piece and any(touch(v, other) for other in edge)}
        found.append(piece)
        left = [v for v in left if v not in piece]
    return found


def by_faces(volume: Tensor) -> Tensor:
    """What `face_connected` is to return: all paths of least cost are raised, until each part is one piece."""
    volume = volume.clone()
    while True:
        parts = [(part, pieces_of(part)) for part in groups(above(volume), 1)]
        raised = set[Voxel]()
        for part, pieces in parts:
            beside = [v for v in everywhere(volume) if v not in part and distance(v, part) == 1]
            cost = {v: 2 - volume[v].item() for v in beside} | dict.fromkeys(part, 0.0)
            there = costs_from(max(pieces, key=len), cost, touch)
            for piece in pieces:
                back = costs_from(piece, cost, touch)
                least = there[min(piece)] + 1e-5
                raised |= {v for v in beside if v in there if there[v] + back[v] - cost[v] <= least}
        if not raised:
            return volume
        for v in raised:
            volume[v] = 0.75


@settings(deadline=None, max_examples=25)
@given(st.builds(drawn, st.integers(0, 10_000), st.tuples(*[st.integers(1, 5)] * 3), st.sampled_from([0.05, 0.2, 0.4])))
def test_face_connected_is_the_reference(x: Tensor) -> None:
    for volume, found in zip(x, face_connected(x), strict=True):
        assert torch.equal(found, by_faces(volume))


# Laws


@settings(deadline=None, max_examples=25)
@given(volumes)
def test_parts_are_connected_by_faces_then_and_nothing_else_is_raised(x: Tensor) -> None:
    found = face_connected(x)
    assert torch.equal(face_connected(found), found) and torch.equal(face_connected(x[0]), found[0])
    assert ((found == x) | ((found == 0.75) & (x <= 0.5))).all()
    for before, after in zip(x, found, strict=True):
        parts = groups(above(after), 1)
        assert len(parts) <= len(groups(above(before), 1)) and all(len(pieces_of(part)) == 1 for part in parts)


def test_a_slanted_leg_stays_on_the_surface() -> None:
    x = 0.8 * table()[0]  # of ones edges are joined
    ground = isosurface(x, largest=True)[0][:, 1].min()  # which the straight one reaches
    x[3, :10, 3] = 0
    assert isosurface(x, largest=True)[0][:, 1].min() > 0
    assert isosurface(face_connected(x), largest=True)[0][:, 1].min() == ground


@settings(deadline=None, max_examples=25)
@given(volumes)
def test_joining_once_is_enough_each_volume_alone_and_nothing_is_removed(x: Tensor) -> None:
    found = joined_parts(x)
    assert torch.equal(joined_parts(found), found)
    assert torch.equal(torch.cat([joined_parts(volume[None]) for volume in x]), found)
    assert torch.equal(joined_parts(x[0]), found[0])
    assert ((found == x) | ((found == 0.75) & (x > 0.02) & (x <= 0.5))).all()
    for before, after in zip(x, found, strict=True):
        assert len(groups(above(after), 1)) <= len(groups(above(before), 1))


def test_a_back_behind_a_soft_gap_stays_and_a_crumb_does_not() -> None:
    chair = torch.zeros(12, 16, 12)
    chair[2:10, 4:7, 2:10], chair[2:10, 9:15, 8:10] = 0.9, 0.8
    chair[3, 7:9, 8], chair[8, 7:9, 8] = torch.tensor([0.4, 0.2]), torch.tensor([0.4, 0.01])  # one post, and a stump
    chair[5, 12, 5:8] = torch.tensor([0.9, 0.4, 0.4])  # a voxel that is two from the back
    found = largest_part(joined_parts(chair))
    assert (found[2:10, 9:15, 8:10] == 0.8).all() and found[5, 12, 5] == 0
    assert (found[3, 7:9, 8] == 0.75).all() and found[8, 7, 8] == pytest.approx(0.4)
    assert (largest_part(chair)[2:10, 9:15, 8:10] == 0).all()


def test_a_gap_that_is_empty_too_wide_or_longer_than_the_part_is_not_joined() -> None:
    x = torch.zeros(1, 13, 3, 3)
    x[0, :2], x[0, 4:7] = 1, 1
    for between, parts in ((0, 2), (0.02, 2), (0.03, 1)):
        x[0, 2:4] = between
        assert len(groups(above(joined_parts(x)[0]), 1)) == parts
    x[0] = 0
    x[0, :2], x[0, 7:10], x[0, 12, 1, 1] = 1, 1, 1  # gaps of five voxels, and of two before a crumb
    x[0, 2:7], x[0, 10:12] = 0.1, 0.4
    assert torch.equal(joined_parts(x), x)
    assert len(groups(above(joined_parts(x, gap=5)[0]), 1)) == 2
    assert joined_parts(x > 0.5).dtype == torch.bool and torch.equal(joined_parts(x > 0.5), x > 0.5)


def test_a_symmetric_shape_stays_symmetric() -> None:
    chair = torch.zeros(12, 16, 12)
    chair[2:10, 4:7, 2:10], chair[2:10, 9:15, 8:10] = 0.9, 0.8
    chair[3, 7:9, 8], chair[8, 7:9, 8] = 0.4, 0.4 - 1e-6
    found = joined_parts(chair)
    assert (found[3, 7:9, 8] == 0.75).all() and (found[8, 7:9, 8] == 0.75).all()


@pytest.mark.parametrize("mirrored", [(0,), (1,), (2,), (0, 1, 2)])
def test_what_is_joined_by_faces_stays_symmetric(mirrored: tuple[int, ...]) -> None:
    x = torch.rand(4, 8, 8, 8, generator=torch.Generator().manual_seed(0)).square()
    x = (x + x.flip([1 + axis for axis in mirrored])) / 2
    x[:, 2:6, 2:6, 2:6] = 1  # the largest piece, and no other is as large
    x = largest_part(x)
    found = face_connected(x)
    assert (found != x).any() and torch.equal(found, found.flip([1 + axis for axis in mirrored]))


def test_more_between_does_not_part_what_less_joins() -> None:
    x = torch.zeros(1, 14, 7, 1)
    x[0, :4, :3], x[0, 8:12, :3], x[0, 4:8, 0] = 1, 1, 0.03
    assert len(groups(above(joined_parts(x)[0]), 1)) == 1
    x[0, [3, 4, 5, 6, 7], [3, 4, 4, 4, 3]] = 0.5  # a fuller path of five
    assert len(groups(above(joined_parts(x)[0]), 1)) == 1


def test_haze_is_not_filled() -> None:
    x = torch.rand(1, 12, 12, 12, generator=torch.Generator().manual_seed(0)) * 0.002 + 0.03
    x[:, :4], x[:, 8:] = 1, 1
    assert 0 < (joined_parts(x) == 0.75).sum() <= 12


def test_values_above_one_and_other_levels() -> None:
    for full in (1.0, 1.5, 2.0, 3.0):
        x = torch.tensor([full, full, 0.25, full]).view(1, 4, 1, 1)
        assert joined_parts(x).flatten().tolist() == [full, full, 0.75, full]
        assert torch.equal(joined_parts(x, level=0.2), x)
        assert joined_parts(x, level=0.3).flatten()[2] == pytest.approx(0.65)


def test_gaps_of_large_volumes_may_be_an_eighth_of_their_side() -> None:
    x = torch.full((1, 1, 52, 1), 0.1)
    x[..., :20, :], x[..., 26:33, :], x[..., 40:, :] = 1, 1, 1  # gaps of six and of seven voxels
    assert len(groups(above(joined_parts(x)[0]), 1)) == 2


@settings(deadline=None, max_examples=25)
@given(volumes)
def test_once_is_enough_each_volume_alone_and_nothing_is_added(x: Tensor) -> None:
    found = largest_part(x)
    assert torch.equal(largest_part(found), found)
    assert torch.equal(torch.cat([largest_part(volume[None]) for volume in x]), found)
    assert torch.equal(largest_part(x[None])[0], found) and torch.equal(largest_part(x[0]), found[0])
    assert ((found == x) | (found == 0)).all()
    assert all(len(number_parts((volume > 0.5).numpy())[1]) <= 2 for volume in found)


@settings(deadline=None, max_examples=25)
@given(volumes)
def test_the_gradient_passes_through_what_stays(x: Tensor) -> None:
    p = x.clone().requires_grad_()
    largest_part(p).sum().backward()
    assert p.grad is not None and torch.equal(p.grad * x, largest_part(x))


# What stays


def table() -> Tensor:
    """A top with a soft rim of two voxels on one-voxel legs, one of them slanted; (1, 16, 16, 16)."""
    x = torch.zeros(1, 16, 16, 16)
    x[:, 1:15, 8:13, 1:15], x[:, 2:14, 9:12, 2:14], x[:, 3:13, 10, 3:13] = 0.1, 0.4, 1
    x[:, 3, 0:10, 3] = 1
    for k in range(10):
        x[:, 3 + k, 9 - k, 12] = 1
    return x


def test_thin_legs_and_soft_rims_stay() -> None:
    assert torch.equal(largest_part(table()), table())
    assert not any(found.any() for found in floating_parts(table()))


def test_a_crumb_goes_with_its_rim_and_nothing_else() -> None:
    x = table()
    x[:, 9:, 0:4, 0:4] = 0.2
    x[:, 14, 1:3, 1] = 0.9
    assert torch.equal(largest_part(x)[:, :, 6:], table()[:, :, 6:])
    assert largest_part(x)[:, 9:, 0:4, 0:4].sum() == 0


def test_the_surface_is_that_of_the_part() -> None:
    rng = np.random.default_rng(0)
    x = torch.from_numpy(rng.random((1, 12, 12, 12))) ** 2 * 0.8
    found, wanted = isosurface(largest_part(x)[0].numpy(), largest=True), isosurface(x[0].numpy(), largest=True)
    assert len(number_parts((x[0] > 0.5).numpy())[1]) > 5 and len(wanted[0]) > 50
    assert np.array_equal(found[0], wanted[0]) and np.array_equal(found[1], wanted[1])


def test_what_is_empty_stays_empty() -> None:
    assert largest_part(torch.zeros(2, 4, 4, 4)).sum() == 0 and largest_part(torch.zeros(0, 4, 4, 4)).shape[0] == 0
    haze = torch.full((1, 4, 4, 4), 0.5)
    assert torch.equal(largest_part(haze), haze) and not floating_parts(haze)[0].any()


def test_the_level_decides_what_a_part_is() -> None:
    x = torch.tensor([1.0, 1.0, 0.3, 1.0]).view(1, 4, 1, 1)
    assert largest_part(x).sum() == pytest.approx(2.3) and torch.equal(largest_part(x, level=0.2), x)
    assert floating_parts(x)[1].sum() == 1 and not floating_parts(x, level=0.2)[1].any()


def test_volumes_of_bits_stay_bits() -> None:
    x = torch.zeros(1, 8, 8, 8, dtype=torch.bool)
    x[:, :4, :4, :4], x[:, 6, 6, 6] = True, True
    assert largest_part(x).dtype == torch.bool and largest_part(x).sum() == 64


def test_pictures_are_refused() -> None:
    with pytest.raises(UserError, match="holds no volumes"):
        face_connected(torch.zeros(4, 4))
    with pytest.raises(UserError, match="holds no volumes"):
        largest_part(torch.zeros(4, 4))
    with pytest.raises(UserError, match="holds no volumes"):
        joined_parts(torch.zeros(4, 4))


@pytest.mark.parametrize("shape", [(0, 4, 4, 4), (2, 0, 4, 4), (2, 4, 4, 0), (0, 0, 0), (0, 2, 3, 3, 3)])
def test_empty_arrays_stay_as_they_are(shape: tuple[int, ...]) -> None:
    for rule in (largest_part, joined_parts, face_connected):
        assert rule(torch.zeros(shape)).shape == shape


# Gaps


@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("gap", [1, 2, 3])
def test_what_is_within_two_voxels_does_not_float(gap: int, place: int) -> None:
    x = torch.zeros(1, 12, 3, 3)
    x[:, place : place + 3, 1, 1] = 1
    x[:, place + 3 + gap :, 1, 1] = 1
    floating, gaps = floating_parts(x)
    assert floating.any() == (gap == 3)
    assert gaps[0, :, 1, 1].nonzero().flatten().tolist() == ([place + 3 + k for k in range(gap)] if gap < 3 else [])


def test_a_part_may_be_near_to_one_that_is_near() -> None:
    x = torch.zeros(1, 16, 1, 1)
    x[:, [0, 1, 4, 7, 12]] = 1
    floating, gaps = (found.flatten().nonzero().flatten().tolist() for found in floating_parts(x))
    assert floating == [11, 12, 13] and gaps == [2, 3]
