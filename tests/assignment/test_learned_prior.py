"""A prior that is learned: its draws, its gradient, and that it finds a distribution that nobody told it."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from unproject._random import generator_at
from unproject._types import UserError
from unproject.adversarial.penalties import R1R2
from unproject.assignment import LearnedPrior, LearnedPriorState, Panel
from unproject.assignment.learned_prior import project_softly
from unproject.data import Collection
from unproject.networks import Discriminator, Generator
from unproject.projections.line_integral import directions
from unproject.training import Adam, Recipe, train


def state(count: int, **settings: float) -> LearnedPriorState:
    """The state of a panel of so many directions."""
    panel = Panel(directions(count, 0.1), Collection(torch.zeros(5, 1, 16)), LearnedPrior(**settings))  # type: ignore[arg-type]
    begun = panel.assignment.begin(panel, 0)
    assert isinstance(begun, LearnedPriorState)
    return begun


def test_draws_follow_the_shares() -> None:
    distribution = state(4)
    wanted = torch.tensor([0.5, 0.3, 0.15, 0.05])
    distribution.logits.data = wanted.log() + 3
    torch.testing.assert_close(distribution.shares, wanted)
    for temperature in (0.1, 2.0):
        distribution.settings = LearnedPrior(temperature=temperature)
        u = distribution.relaxed(20_000, generator_at(0))
        torch.testing.assert_close(u.sum(1), torch.ones(20_000))
        drawn = torch.bincount(u.argmax(1), minlength=4) / 20_000
        assert (drawn - wanted).abs().max() < 0.015  # four standard errors
    distribution.settings = LearnedPrior(temperature=0.02)
    assert u.max(1).values.mean() < 0.9 < distribution.relaxed(100, generator_at(0)).max(1).values.mean()
    views = torch.bincount(distribution.draw_views(20_000, generator_at(1)), minlength=4) / 20_000
    assert (views - wanted).abs().max() < 0.015


def test_the_loss_is_log_k_minus_the_entropy() -> None:
    distribution = state(5, entropy_weight=2.0)
    assert distribution.loss(torch.zeros(0), torch.zeros(0), 0.0).item() == pytest.approx(0, abs=1e-6)
    distribution.logits.data = torch.tensor([100.0, 0, 0, 0, 0])
    assert distribution.loss(torch.zeros(0), torch.zeros(0), 0.0).item() == pytest.approx(
        2 * torch.tensor(5.0).log().item(), rel=1e-5
    )


def shifted(x: Tensor, way: Tensor) -> Tensor:
    return x * (way + 1.0)[:, None]


def test_projections_are_those_of_the_hard_draw_and_the_gradient_that_of_all_views() -> None:
    x = torch.rand(6, 3, generator=generator_at(0)).requires_grad_()
    u = torch.rand(6, 4, generator=generator_at(1)).requires_grad_()
    seen = project_softly(shifted, x, u, 4)
    way = u.argmax(1)
    torch.testing.assert_close(seen, shifted(x, way))
    weight = torch.rand(6, 3, generator=generator_at(2))
    by_x, by_u = torch.autograd.grad((seen * weight).sum(), (x, u))
    torch.testing.assert_close(by_x, weight * (way + 1.0)[:, None])
    expected = (weight * x.detach()).sum(1)[:, None] * torch.arange(1.0, 5)
    expected[4:] = 0
    torch.testing.assert_close(by_u, expected)


class Constant(Generator):
    """One image, of which everything is known but the views."""

    domain = "images"

    def __init__(self) -> None:
        super().__init__(1)
        self.unused = nn.Parameter(torch.zeros(1))

    def forward(self, code: Tensor) -> Tensor:
        image = torch.zeros(len(code), 1, 16, 16)
        image[:, :, 2:6, 3:9] = 1
        image[:, :, 8:14, 10:12] = 0.7
        return image + 0 * self.unused


TRUE = torch.tensor([0.6, 0.05, 0.25, 0.1])
DIRECTIONS = directions(4, 0.1)


def recipe(settings: LearnedPrior, steps: int = 300) -> Recipe:
    which = torch.multinomial(TRUE, 600, replacement=True, generator=generator_at(5))
    blank = Panel(DIRECTIONS, Collection(torch.zeros(600, 1, 16)))
    lines = Collection(blank.project(Constant()(torch.zeros(600, 1)).detach(), which, generator_at(6)))
    return Recipe(
        Constant,
        [Panel(DIRECTIONS, lines, settings)],
        discriminator=partial(Discriminator, channels=8, shared=4, bottleneck=32),
        penalty=R1R2(0.01, every=4),
        generator_optimiser=Adam(1e-3),
        discriminator_optimiser=Adam(3e-3),
        batch=64,
        steps=steps,
    )


def test_it_finds_the_distribution_of_views(tmp_path: Path) -> None:
    """The mutant gives the distribution no gradient: it stays uniform, 0.35 from the truth."""
    made = recipe(LearnedPrior(rate=0.02, entropy_weight=0.0))
    run = train(made, tmp_path / "run", quiet=True)
    shares = [torch.tensor(line["views"]) for line in run.stats() if "views" in line]
    found = torch.stack(shares[-10:]).mean(0)
    assert (found - TRUE).abs().max() < 0.12, found
    (stored,) = run.assignments()
    assert isinstance(stored, LearnedPriorState) and torch.allclose(stored.shares, shares[-1], atol=1e-3)
    assert (torch.full((4,), 0.25) - TRUE).abs().max() > 0.3


def test_the_entropy_weight_moves_it_to_the_uniform_one(tmp_path: Path) -> None:
    run = train(recipe(LearnedPrior(rate=0.02, entropy_weight=10.0), steps=100), tmp_path / "run", quiet=True)
    assert max(run.stats()[-1]["views"]) < 0.3


def test_data_that_cannot_share_a_prior_are_refused() -> None:
    lines = Collection(torch.rand(4, 1, 16))
    for panel in (
        Panel(DIRECTIONS[:1], lines, LearnedPrior()),
        Panel(DIRECTIONS[:2], [lines, Collection(torch.rand(4, 1, 16))], LearnedPrior()),
    ):
        with pytest.raises(UserError, match="LearnedPrior: give the panel at least two"):
            panel.assignment.begin(panel, 0)


@pytest.mark.parametrize("wrong", [{"rate": 0}, {"temperature": 0}, {"images": 0}, {"entropy_weight": -1}])
def test_settings_that_make_no_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(UserError, match="positive rate"):
        LearnedPrior(**wrong)  # type: ignore[arg-type]
