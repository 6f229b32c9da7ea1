"""The procedural chairs: what they promise, for many of them."""

from __future__ import annotations

import pytest
import torch
from scipy import ndimage

from unproject._types import UserError
from unproject.data import BASES, PARAMETERS, build_chairs, chair_parameters, chairs
from unproject.data.procedural.shapes.chairs import back_of, base_of


@pytest.fixture(scope="module")
def many():
    return chairs(200, 32, seed=0)


def test_they_are_a_function_of_the_seed_and_a_prefix_of_more(many):
    assert torch.equal(chairs(200, 32, seed=0, chunk=33), many)
    assert torch.equal(chairs(7, 32, seed=0), many[:7])
    assert not torch.equal(chairs(7, 32, seed=1), many[:7])


@pytest.mark.parametrize("resolution", [24, 32, 33, 64])
def test_left_is_the_mirror_image_of_right(resolution):
    some = chairs(20, resolution, soft=True)
    assert torch.equal(some, some.flip(1)) and some.shape == (20,) + (resolution,) * 3


def test_they_lie_inside_the_cylinder_and_are_centred(many):
    occupied = many > 0
    centre = (2 * torch.arange(32) + 1 - 32) / 32
    radius = torch.hypot(centre[:, None], centre[None])
    assert float((radius * occupied.any(2)).max()) <= 0.95
    height = occupied.any(3).any(1)
    assert float(centre[height.any(0)].abs().max()) <= 0.9
    for axis in (1, 2, 3):
        along = occupied.any(dim=tuple(a for a in (1, 2, 3) if a != axis)).float()
        low, high = along.argmax(1), 31 - along.flip(1).argmax(1)
        assert float((low + high - 31).abs().max()) <= 2


def test_the_most_extreme_parameters_stay_inside_too():
    ends = torch.rand(300, len(PARAMETERS), generator=torch.Generator().manual_seed(0)) > 0.5
    spans = enumerate(PARAMETERS.items())
    occupied = build_chairs({name: torch.where(ends[:, k], s.high, s.low) for k, (name, s) in spans}) > 0
    centre = (2 * torch.arange(32) + 1 - 32) / 32
    radius = torch.hypot(centre[:, None], centre[None]) * occupied.any(2)
    assert 0.88 < float(radius.max()) <= 0.95
    assert float((centre.abs() * occupied.any(3).any(1)).max()) <= 0.9


def test_they_face_forward_with_the_back_behind(many):
    upper = many[:, :, 22:].sum((1, 2))
    behind, before = upper[:, :16].sum(1), upper[:, 16:].sum(1)
    assert float((behind > before).float().mean()) > 0.95


def test_each_is_one_piece_that_stands_on_the_floor(many):
    neighbours = torch.ones(3, 3, 3).numpy()
    assert all(ndimage.label(chair.numpy(), neighbours)[1] == 1 for chair in many[:100])


def test_no_two_are_alike_and_styles_all_occur(many):
    flat = many[:100].flatten(1)
    same = flat @ flat.T
    size = flat.sum(1)
    iou = same / (size[:, None] + size[None] - same)
    assert float((iou - 2 * torch.eye(100)).max()) < 0.95 and float(iou.median()) < 0.4
    parameters = chair_parameters(200)
    assert set(base_of(parameters).tolist()) == {0, 1, 2, 3} and set(back_of(parameters).tolist()) == {0, 1, 2, 3}


def test_parameters_stay_in_their_ranges_and_are_many():
    drawn = chair_parameters(500, seed=3)
    assert len(PARAMETERS) >= 8
    for name, span in PARAMETERS.items():
        assert span.low <= float(drawn[name].min()) < float(drawn[name].max()) <= span.high


@pytest.mark.parametrize("name", sorted(PARAMETERS))
def test_every_parameter_changes_some_chair(name):
    low, high = chair_parameters(60), chair_parameters(60)
    low[name], high[name] = torch.full((60,), PARAMETERS[name].low), torch.full((60,), PARAMETERS[name].high)
    assert not torch.equal(build_chairs(low, 32), build_chairs(high, 32))


def test_silhouettes_see_the_legs(many):
    """From the front, below the seat of a four-legged chair, there is a left leg and a right one all the way down."""
    parameters = chair_parameters(200)
    legged = many[(base_of(parameters) == BASES.index("four legs"))]
    front = legged.amax(3)
    for picture in front:
        feet = picture.any(0).float().argmax()
        assert (picture[:16, feet : feet + 5].amax(0) == 1).all() and picture[15:17, feet].sum() == 0


def test_soft_volumes_are_the_antialiased_hard_ones():
    soft, hard = chairs(8, 32, soft=True), chairs(8, 32)
    fine = chairs(8, 128)
    pooled = torch.nn.functional.avg_pool3d(fine[:, None], 4)[:, 0]
    assert set(hard.unique().tolist()) == {0.0, 1.0} and ((soft > 0) & (soft < 1)).any()
    assert float((soft - pooled).abs().mean()) < 0.5 * float((hard - pooled).abs().mean())


def test_nonsense_is_refused():
    for count, resolution in ((0, 32), (3, 4)):
        with pytest.raises(UserError, match="chairs: give a count"):
            chairs(count, resolution)
