"""Matching: real images lose nothing, others are moved to the statistics of real ones; a stored state goes on."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.adversarial import Matching, MatchingState


def drawn(n: int, rho: float, seed: int, size: int = 16) -> Tensor:
    """Return images of two channels whose correlation is ρ."""
    a, b = torch.randn(n, 2, size, size, generator=generator_at(seed)).chunk(2, 1)
    return torch.cat([a, rho * a + (1 - rho**2) ** 0.5 * b], 1) * 0.2 + 0.5


def begun(rho: float = 0.8, **settings: float) -> MatchingState:
    return Matching(**settings).begin(drawn(400, rho, 0))


def test_images_as_real_ones_lose_nothing_and_others_do() -> None:
    losses = {}
    for rho in (0.8, 0.0, -0.8):
        state = begun()
        for k in range(60):
            loss = state(drawn(8, rho, 1 + k))
        losses[rho] = loss.item()
    assert losses[0.8] < 0.02 < 20 * losses[0.8] < losses[0.0] < losses[-0.8]


def test_few_images_of_the_moving_means_are_enough() -> None:
    """Of one batch of eight statistics are uncertain by a third of their deviation; of the moving means by little."""
    first, state = begun(), begun()
    alone = first(drawn(8, 0.8, 1)).item()
    for k in range(100):
        last = state(drawn(8, 0.8, 1 + k)).item()
    assert last < 0.2 * alone


def test_its_gradient_moves_a_correlation_to_that_of_real_images() -> None:
    state, rho = begun(memory=0.1), torch.tensor(0.0, requires_grad=True)
    for k in range(200):
        a, b = torch.randn(8, 2, 16, 16, generator=generator_at(5 + k)).chunk(2, 1)
        r = rho.tanh()
        (gradient,) = torch.autograd.grad(state(torch.cat([a, r * a + (1 - r**2).sqrt() * b], 1) * 0.2 + 0.5), rho)
        with torch.no_grad():
            rho -= 0.1 * gradient.sign() * 0.98**k
    assert rho.tanh().item() == pytest.approx(0.8, abs=0.05)


def test_images_that_are_all_alike_are_not_as_real_ones() -> None:
    """The deviation between images counts: half with more contrast and half with less are not all with the mean."""

    def scaled(n: int, seed: int, logarithm: float) -> Tensor:
        return (drawn(n, 0.5, seed) - 0.5) * math.exp(logarithm) + 0.5

    mixed = torch.cat([scaled(200, 0, 0.5), scaled(200, 1, -0.5)])
    state, alike = Matching().begin(mixed), Matching().begin(mixed)
    for k in range(100):
        true = state(torch.cat([scaled(4, 10 + k, 0.5), scaled(4, 200 + k, -0.5)]))
        false = alike(scaled(8, 10 + k, 0.0))
    assert false > 3 * true


def test_a_stored_state_goes_on_as_it_would_have() -> None:
    one, other = begun(), begun()
    for k in range(3):
        one(drawn(8, 0.3, k))
    one.gradient_norm = 0.25
    other.load_state_dict(one.state_dict())
    assert other.gradient_norm == 0.25 and int(other.seen) == 3
    assert torch.equal(one(drawn(8, 0.3, 9)), other(drawn(8, 0.3, 9)))
    assert one.log() == other.log()


def test_its_weight_falls_and_makes_up_for_the_updates_without_it() -> None:
    state = begun(weight=2.0, final=0.5, every=2)
    assert [state.due(step) for step in range(4)] == [True, False, True, False]
    assert [state.weight_at(progress) for progress in (0.0, 0.5, 1.0, 1.2)] == [4.0, 2.5, 1.0, 1.0]


@pytest.mark.parametrize(
    "settings", [{"weight": 0.0}, {"weight": -1.0}, {"memory": 0.0}, {"memory": 1.5}, {"every": 0}, {"final": -1.0}]
)
def test_settings_out_of_range(settings: dict[str, float]) -> None:
    with pytest.raises(UserError, match="give a positive weight"):
        Matching(**settings)


def test_what_all_real_images_share_counts_as_much_as_the_rest() -> None:
    """If asked for: of grey pictures all statistics of colours are alike; a little colour is no thousandfold loss."""

    def grey(n: int, seed: int, colour: float = 0.0) -> Tensor:
        rng = generator_at(seed)
        contrast = 0.1 + 0.1 * torch.rand(n, 1, 1, 1, generator=rng)
        x = contrast * torch.randn(n, 1, 16, 16, generator=rng) + 0.5
        return x + colour * torch.randn(n, 3, 16, 16, generator=rng)

    losses = {}
    for alike in (None, 1e-5):
        for colour in (0.0, 0.02):
            state = Matching(alike=alike).begin(grey(200, 0))
            for k in range(40):
                loss = state(grey(8, 1 + k, colour))
            losses[alike, colour] = loss.item()
    assert losses[None, 0.02] > 100
    assert losses[1e-5, 0.0] + 0.1 < losses[1e-5, 0.02] < 3
    real = grey(200, 0)
    assert Matching(alike=1e-5).begin(real)(real) < 0.01  # real pictures are the best ones


@pytest.mark.parametrize("alike", [0.0, -1.0, math.nan, math.inf])
def test_what_is_alike_deviates_by_a_number(alike: float) -> None:
    with pytest.raises(UserError, match="alike is a positive deviation"):
        Matching(alike=alike)
