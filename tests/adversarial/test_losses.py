"""Losses against values worked out by hand, and the direction in which each player pulls."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from unproject.adversarial.losses import Hinge, Logistic, Loss, Relativistic, Wasserstein

REAL, FAKE = torch.tensor([1.0, -2.0]), torch.tensor([0.5, 3.0])
LOSSES = [Wasserstein(), Hinge(), Relativistic(), Logistic()]


def softplus(x: float) -> float:
    return math.log(1 + math.exp(x))


@pytest.mark.parametrize(
    "loss, discriminator, generator",
    [
        (Wasserstein(), 1.75 + 0.5, -1.75),
        (Hinge(), (0 + 3) / 2 + (1.5 + 4) / 2, -1.75),
        (Relativistic(), (softplus(-0.5) + softplus(5)) / 2, (softplus(0.5) + softplus(-5)) / 2),
        (
            Logistic(),
            (softplus(-1) + softplus(2) + softplus(0.5) + softplus(3)) / 2,
            (softplus(-0.5) + softplus(-3)) / 2,
        ),
    ],
)
def test_values_by_hand(loss: Loss, discriminator: float, generator: float) -> None:
    assert loss.discriminator(REAL, FAKE).item() == pytest.approx(discriminator)
    assert loss.generator(REAL, FAKE).item() == pytest.approx(generator)


def slope(f: Callable[[Tensor], Tensor], at: Tensor) -> float:
    """The numeric derivative of f when all logits rise together."""
    h = 1e-3
    return ((f(at + h) - f(at - h)) / (2 * h)).item()


@pytest.mark.parametrize("loss", LOSSES, ids=lambda loss: type(loss).__name__)
def test_the_discriminator_raises_the_real_and_lowers_the_generated(loss: Loss) -> None:
    real, fake = 0.1 * REAL.double(), 0.1 * FAKE.double()
    assert slope(lambda r: loss.discriminator(r, fake), real) < -0.3
    assert slope(lambda f: loss.discriminator(real, f), fake) > 0.3
    assert slope(lambda f: loss.generator(real, f), fake) < -0.3


def test_the_hinge_leaves_alone_what_is_beyond_the_margin() -> None:
    far = torch.tensor([1.5, 2.0], dtype=torch.float64)
    assert slope(lambda r: Hinge().discriminator(r, -far), far) == 0
    assert slope(lambda f: Hinge().discriminator(far, f), -far) == 0


def test_only_the_relativistic_loss_depends_on_the_pairing() -> None:
    unlike = {type(loss) for loss in LOSSES if loss.discriminator(REAL, FAKE) != loss.discriminator(REAL.flip(0), FAKE)}
    assert unlike == {Relativistic}


def test_the_relativistic_generator_is_the_discriminator_with_the_roles_exchanged() -> None:
    assert Relativistic().generator(REAL, FAKE) == Relativistic().discriminator(FAKE, REAL)
