"""Regularisers against their formula, and its gradient."""

from __future__ import annotations

import math

import pytest
import torch

from unproject.adversarial.regularisers import Solid


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
    assert Solid()(volumes(1.0), 0.0).item() == pytest.approx(0, abs=1e-6)


def test_filling_lowers_it_and_scaling_pulls_on_thin_and_full_volumes_alike() -> None:
    x = volumes(0.1, 0.8)
    Solid(weight=1.0)(x, 0.0).backward()
    assert x.grad is not None and (x.grad < 0).all()
    torch.testing.assert_close((x.grad * x.detach()).sum((1, 2, 3)), torch.full((2,), -0.5).double(), rtol=1e-4, atol=0)
