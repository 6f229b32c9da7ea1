"""Regularisers against their formula, and its gradient."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch

from unproject._types import UserError
from unproject.adversarial.regularisers import Centred, Connected, Rectilinear, Regularisers, Solid, Varied
from unproject.ops.parts import number_parts


def volumes(*fullness: float) -> torch.Tensor:
    return torch.tensor(fullness, dtype=torch.float64).view(-1, 1, 1, 1).expand(-1, 4, 4, 4).clone().requires_grad_()


def test_solid_is_the_mean_logarithm_of_fullness() -> None:
    value = Solid(weight=0.5)(volumes(0.1, 0.4), 0.0).item()
    assert value == pytest.approx(-0.5 * (math.log(0.1) + math.log(0.4)) / 2, rel=1e-4)


@pytest.mark.parametrize("progress, weight", [(0.0, 0.4), (0.5, 0.3), (1.0, 0.2), (1.5, 0.2)])
def test_its_weight_falls_in_a_straight_line(progress: float, weight: float) -> None:
    value = Solid(weight=0.4, final=0.2)(volumes(0.1), progress).item()
    assert value == pytest.approx(-weight * math.log(0.1), rel=1e-4)


def test_empty_volumes_are_finite_and_full_ones_cost_nothing() -> None:
    assert math.isfinite(Solid()(volumes(0.0), 0.0).item())
    logits = torch.full(
        (1, 4, 4, 4), -40.0, requires_grad=True
    )  # as good as empty: the gradient is that of fuller ones
    Solid(weight=1.0)(logits.sigmoid(), 0.0).backward()
    assert logits.grad is not None and logits.grad.sum().item() == pytest.approx(-1, rel=1e-3)
    assert Solid()(volumes(1.0), 0.0).item() == pytest.approx(0, abs=1e-6)


def test_filling_lowers_it_and_scaling_pulls_on_thin_and_full_volumes_alike() -> None:
    x = volumes(0.1, 0.8)
    Solid(weight=1.0)(x, 0.0).backward()
    assert x.grad is not None and (x.grad < 0).all()
    torch.testing.assert_close((x.grad * x.detach()).sum((1, 2, 3)), torch.full((2,), -0.5).double(), rtol=1e-4, atol=0)


# Centred


@pytest.mark.parametrize("axis", range(3), ids="xyz")
def test_centred_is_the_square_of_how_far_the_centre_of_mass_is_off(axis: int) -> None:
    x = torch.zeros(2, 8, 8, 8)
    x[:, 3:5, 3:5, 3:5] = 0.7
    x[1] = x[1].roll(2, axis)
    assert Centred(3.0)(x[:1], 0.0).item() == pytest.approx(0, abs=1e-6)
    assert Centred(3.0)(x, 0.5).item() == pytest.approx(3.0 * 0.5**2 / 2)
    others = "xyz".replace("xyz"[axis], "")
    assert Centred(3.0, others)(x, 0.0).item() == pytest.approx(0, abs=1e-6)


def test_centred_moves_a_body_back_to_the_middle() -> None:
    place = torch.full((1,), 0.3, requires_grad=True)
    height = torch.arange(16.0) / 8 - 15 / 16
    for _ in range(50):
        x = torch.sigmoid(20 * (0.4 - (height - place).abs()))[None, None, :, None].expand(1, 16, 16, 16)
        (slope,) = torch.autograd.grad(Centred(1.0)(x, 0.0), place)
        place = (place - 0.1 * slope).detach().requires_grad_()
    assert abs(place.item()) < 1e-3 and math.isfinite(Centred()(volumes(0.0), 0.0).item())


# Rectilinear


def seen_from_above(plan: torch.Tensor, height: int = 5) -> torch.Tensor:
    """Volumes (1, 32, 32, 32), full over the plan (32, 32) up to some height."""
    x = torch.zeros(1, 32, 32, 32)
    x[:, :, :height] = plan.float()[:, None]
    return x


ROW, COLUMN = torch.meshgrid(torch.arange(32) - 15.5, torch.arange(32) - 15.5, indexing="ij")
PLANS = {
    "square": (torch.maximum(ROW.abs(), COLUMN.abs()) < 6, 0.0),
    "rectangle of 2 : 1": (torch.maximum(ROW.abs() / 2, COLUMN.abs()) < 6, 0.0),
    "ellipse": (ROW.square() / 4 + COLUMN.square() < 7.2**2, math.log(4 / math.pi)),
    "disc": (ROW.square() + COLUMN.square() < 14.2**2, math.log(4 / math.pi)),
    "on its corner": (ROW.abs() + COLUMN.abs() < 14.5, math.log(2)),
    "at the walls": (torch.ones(32, 32), 0.0),
}


@pytest.mark.parametrize("plan, value", PLANS.values(), ids=list(PLANS))
def test_rectilinear_of_plans_by_hand(plan: torch.Tensor, value: float) -> None:
    dense = Rectilinear(2.0, 2.0, density=20.0)
    assert dense(seen_from_above(plan), 0.0).item() == pytest.approx(2 * value, abs=0.15)  # of voxels


def test_it_depends_neither_on_size_nor_on_density_nor_on_what_is_beneath() -> None:
    square, table = (seen_from_above(PLANS["square"][0]) for _ in range(2))
    table[:, :, :3] = 0
    table[:, 11, :3, 11] = 1
    small = seen_from_above(torch.maximum(ROW.abs(), COLUMN.abs()) < 3)
    values = [Rectilinear(1.0, density=d)(x, 0.0).item() for x in (square, small) for d in (0.001, 0.1, 20.0)]
    assert values == pytest.approx([0.0] * 6, abs=1e-3)
    assert Rectilinear(1.0, density=20.0)(table, 0.0).item() == pytest.approx(0.0, abs=1e-3)


def test_descent_makes_a_disc_a_square_along_the_axes() -> None:
    logits = (20.0 - ROW.square() - COLUMN.square() + 30).div(10).clamp(-4, 4).requires_grad_()
    area = logits.sigmoid().sum().item()
    adam = torch.optim.Adam([logits], 0.05)
    for _ in range(600):
        x = logits.sigmoid()[None, :, None].expand(1, 32, 4, 32)
        loss = Rectilinear(1.0, density=1.0)(x, 0.0) + (logits.sigmoid().sum() / area - 1).square()
        adam.zero_grad()
        loss.backward()
        adam.step()
    assert Rectilinear(1.0, density=1.0)(logits.detach().sigmoid()[None, :, None].expand(1, 32, 4, 32), 0.0) < 0.1


def test_empty_volumes_are_finite_and_its_weight_falls_geometrically() -> None:
    x = volumes(0.0)
    Rectilinear()(x, 0.0).backward()
    assert x.grad is not None and x.grad.isfinite().all()
    disc = seen_from_above(PLANS["disc"][0])
    falling = Rectilinear(0.9, 0.1, until=0.4)
    for progress, weight in ((0.0, 0.9), (0.4, 0.9), (0.45, 0.3), (0.5, 0.1), (1.5, 0.1)):
        assert falling(disc, progress).item() == pytest.approx(Rectilinear(weight, weight)(disc, 0.0).item())


# Varied


def box(x: int, y: int, z: int) -> torch.Tensor:
    """A box (1, 32, 32, 32) of so many voxels a side."""
    full = torch.zeros(1, 32, 32, 32)
    full[:, 2 : 2 + x, 1 : 1 + y, 3 : 3 + z] = 1
    return full


BOX = (8, 12, 16)


@pytest.mark.parametrize(
    "other, differences",
    [
        (BOX, (0, 0, 0)),
        ((4, 6, 8), (0, 0, 0)),
        ((8, 6, 16), (2, 2, 1)),
        ((16, 12, 16), (2, 1, 2)),
        ((8, 12, 8), (1, 2, 2)),
        ((16, 12, 8), (2, 2, 4)),
    ],
)
def test_varied_of_boxes_by_hand(other: tuple[int, ...], differences: tuple[int, ...]) -> None:
    apart = [math.log(max(1, ratio)) ** 2 for ratio in differences]
    by_hand = sum(math.log1p(2 * 0.09 / (square + 1e-3)) for square in apart) / 3
    dense = Varied(2.0, density=20.0)
    assert dense(torch.cat([box(*BOX), box(*other)]), 1.0).item() == pytest.approx(2 * by_hand, rel=0.01)
    four = torch.cat([box(*BOX), box(*BOX), box(*other), box(*BOX), box(9, 9, 9)])  # the last is left out
    of_alike = 2 * math.log1p(2 * 0.09 / 1e-3)
    assert dense(four, 1.0).item() == pytest.approx((2 * by_hand + of_alike) / 2, rel=0.01)


def test_descent_makes_shapes_differ_and_no_more_than_by_the_spread() -> None:
    sides = torch.tensor([[0.0, 0.01], [0.0, 0.005]], requires_grad=True)
    height = torch.arange(32.0) - 15.5
    adam, gap = torch.optim.Adam([sides], 0.01), []
    for _ in range(150):
        x, z = (torch.sigmoid(8 * torch.exp(s)[:, None] - height.abs()) for s in sides)
        volumes_of = x[:, :, None, None] * torch.ones(4)[None, None, :, None] * z[:, None, None, :]
        loss = Varied(1.0, density=20.0)(volumes_of, 1.0) + 0.5 * sides.square().sum()
        adam.zero_grad()
        loss.backward()
        adam.step()
        gap.append((sides[0] - sides[0].mean()).abs().max().item())
    assert gap[0] < 0.02 and 0.2 < gap[-1] < 1.5


def test_variety_of_one_and_of_empty_ones_is_finite_and_its_weight_rises_late() -> None:
    for x in (volumes(0.0), volumes(0.0, 0.3)):
        Varied()(x, 1.0).backward()
        assert x.grad is not None and x.grad.isfinite().all()
    assert Varied()(volumes(0.5), 1.0) == 0
    alike = torch.cat([box(*BOX), box(*BOX)])
    rising = Varied(0.8, begin=0.4)
    for progress, share in ((0.0, 0.0), (0.4, 0.0), (0.45, 0.25), (0.5, 0.5), (0.6, 1.0), (1.5, 1.0)):
        assert rising(alike, progress).item() == pytest.approx(share * rising(alike, 1.0).item(), abs=1e-6)


# Connected


def broken_table() -> torch.Tensor:
    """A slab of 75 voxels, a leg of one voxel's width whose middle is missing, and a crumb far from both."""
    x = torch.full((1, 12, 12, 12), 0.02)
    x[:, 1:6, 8:11, 1:6] = 0.9
    x[:, 3, 0:8, 3] = 0.9
    x[:, 3, 4, 3] = 0.2
    x[:, 10, 2, 10] = 0.9
    return x


def test_what_floats_is_pushed_down_gaps_up_and_the_rest_not_at_all() -> None:
    x = broken_table().requires_grad_()
    Connected(weight=3.0)(x, 1.0).backward()
    assert x.grad is not None
    push = x.grad * x.detach().sum() / 3
    crumb, gap = torch.zeros_like(push), torch.zeros_like(push)
    crumb[:, 9:12, 1:4, 9:12] = 1
    gap[:, 2:5, 4, 2:5] = 1
    assert torch.equal(push[:, 3, 5:8, 3], torch.zeros(1, 3)) and torch.equal(push[:, 3, 0:4, 3], torch.zeros(1, 4))
    torch.testing.assert_close(push.clamp(min=0), crumb)
    assert push[:, 3, 4, 3] == pytest.approx(-1) and (push[gap > 0] < 0).all()
    assert (push[:, :, 7:] == 0).all()


def test_descent_joins_a_broken_leg_and_removes_a_crumb() -> None:
    logits = broken_table().logit().requires_grad_()
    for _ in range(40):
        x = logits.sigmoid()
        (gradient,) = torch.autograd.grad(Connected()(x, 1.0), logits)
        logits = (logits - 100 * gradient).detach().requires_grad_()
    assert len(number_parts((x[0] > 0.5).detach().numpy())[1]) == 2
    assert x[0, 3, 4, 3] > 0.5 > x[0, 10, 2, 10] and (x[0, 3, :8, 3] > 0.5).all()


def test_connected_is_the_mean_share_of_what_is_misplaced() -> None:
    x = torch.zeros(3, 8, 8, 8)
    x[:, :4, :4, :4] = 1
    x[0, 7, 7, 7] = 1
    x[1, 6, 0, 0] = 0.6  # the gap of two layers is 3 x 3 voxels beside the block and 2 x 2 beside the voxel
    assert Connected(weight=2.0)(x, 1.0).item() == pytest.approx(2 / 3 * (1 / 65 + (9 + 4) / 64.6), rel=1e-5)
    assert Connected(weight=2.0, volumes=1)(x, 1.0).item() == pytest.approx(2 / 65, rel=1e-5)
    assert Connected()(x[2:], 1.0).item() == 0


def test_connected_is_finite_for_empty_volumes() -> None:
    x = volumes(0.0).detach().requires_grad_()
    Connected()(x, 1.0).backward()
    assert x.grad is not None and (x.grad == 0).all()


def test_several_are_summed_and_see_the_progress() -> None:
    x = volumes(0.1, 0.8)
    both = Regularisers((Solid(0.3, 0.0), lambda x, progress: x.mean() * progress))
    assert both(x, 0.5).item() == pytest.approx((Solid(0.15, 0.15)(x, 0.0) + x.mean() / 2).item())


@pytest.mark.parametrize(
    "term, wrong",
    [
        (Solid, {"weight": -1.0}),
        (Solid, {"final": math.nan}),
        (Rectilinear, {"weight": 0.0}),
        (Rectilinear, {"final": -0.3}),
        (Rectilinear, {"until": 0.0}),
        (Rectilinear, {"density": math.inf}),
        (Varied, {"weight": -0.1}),
        (Varied, {"spread": 0.0}),
        (Connected, {"weight": math.nan}),
        (Connected, {"level": 1.0}),
        (Connected, {"volumes": 0}),
        (Centred, {"weight": -1.0}),
        (Centred, {"axes": ""}),
        (Centred, {"axes": "xw"}),
    ],
)
def test_numbers_that_make_no_sense_are_refused(term: Any, wrong: dict[str, Any]) -> None:
    with pytest.raises(UserError, match=f"{term.__name__}.*give "):
        term(**wrong)
