"""The preference for bodies of revolution: what it costs not to be one, and what descent makes of others."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject._types import UserError
from unproject.adversarial import Axisymmetric

N = 32
X, Z = torch.meshgrid(torch.arange(N) - 15.5, torch.arange(N) - 15.5, indexing="ij")
RADIUS = (X.square() + Z.square()).sqrt()
ELLIPSE, DISC = (X / 12).square() + (Z / 6).square() < 1, RADIUS < 8.5
HANDLE = (Z.abs() < 1.1) & (X > 0) & (X < 14)


def extruded(plan: Tensor, height: int = 8) -> Tensor:
    x = torch.zeros(1, N, N, N)
    x[:, :, :height] = plan.float()[:, None]
    return x


def cost(x: Tensor) -> float:
    return Axisymmetric(1.0)(x, 0.0).item()


def test_what_depends_on_the_radius_alone_costs_nothing() -> None:
    smooth = torch.sigmoid(8 - RADIUS)[None, :, None] * torch.linspace(0, 1, N)[:, None]
    assert cost(smooth) < 1e-3
    assert cost(extruded(DISC)) < 0.06 < 0.15 < cost(extruded(ELLIPSE))


def test_it_is_by_hand() -> None:
    """One of 4 x 4 columns is full: four are in the middle, eight farther out, this among them, four in the corners."""
    x = torch.zeros(1, 4, 1, 4)
    x[0, 0, 0, 1] = 1
    radii, counts = torch.tensor([0.5**0.5, 2.5**0.5, 4.5**0.5]), torch.tensor([4.0, 8.0, 4.0])
    shares = (1 - (radii[:, None] - torch.arange(4)).abs()).clamp_min(0)
    middle, farther, corner = shares @ (shares[1] / (counts @ shares).clamp_min(1e-30))
    expected = 4 * middle**2 + 7 * farther**2 + (1 - farther) ** 2 + 4 * corner**2
    assert cost(x) == pytest.approx(expected.item(), rel=1e-5)


def test_neither_size_nor_height_matters() -> None:
    small = (X / 6).square() + (Z / 3).square() < 1
    assert cost(extruded(small)) == pytest.approx(cost(extruded(ELLIPSE)), rel=0.3)
    assert cost(extruded(ELLIPSE, 3)) == pytest.approx(cost(extruded(ELLIPSE, 20)), rel=1e-4)


def test_turns_by_quarters_and_reflections_do_not_matter() -> None:
    x = extruded(ELLIPSE | HANDLE)
    for same in (x.flip(1), x.flip(3), x.rot90(1, (1, 3))):
        assert cost(same) == pytest.approx(cost(x), rel=1e-5)


def test_a_handle_costs_its_share_of_the_volume() -> None:
    handle = cost(extruded(DISC | HANDLE)) - cost(extruded(DISC))
    share = ((DISC | HANDLE).sum() / DISC.sum()).item() - 1
    assert 0.5 * share < handle < share


def test_descent_makes_an_ellipse_round_and_keeps_the_volume() -> None:
    logits = (3 * (1 - (X / 12).square() - (Z / 6).square())).clamp(-4, 4).requires_grad_()
    area = logits.sigmoid().sum().item()
    adam = torch.optim.Adam([logits], 0.05)
    before = cost(logits.detach().sigmoid()[None, :, None].expand(1, N, 2, N))
    for _ in range(150):
        x = logits.sigmoid()[None, :, None].expand(1, N, 2, N)
        loss = Axisymmetric(10.0)(x, 0.0) + (logits.sigmoid().sum() / area - 1).square()
        adam.zero_grad()
        loss.backward()
        adam.step()
    assert cost(logits.detach().sigmoid()[None, :, None].expand(1, N, 2, N)) < 0.1 * before
    assert logits.sigmoid().sum().item() == pytest.approx(area, rel=0.1)


def test_empty_volumes_are_finite_and_bad_weights_refused() -> None:
    x = torch.zeros(2, 8, 8, 8, requires_grad=True)
    Axisymmetric()(x, 0.0).backward()
    assert x.grad is not None and x.grad.isfinite().all()
    for weight in (-1.0, math.inf, math.nan):
        with pytest.raises(UserError, match="weight"):
            Axisymmetric(weight)
