"""A prior that is learned: its draws, its gradient, and that it finds a distribution that nobody told it."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path

import pytest
import torch
from torch import Tensor, nn

from unproject._random import generator_at
from unproject._types import UserError
from unproject.adversarial.learned_prior import LearnedPrior, WayDistribution, look_softly
from unproject.adversarial.penalties import R1R2
from unproject.data import Collection
from unproject.networks import Discriminator, Generator
from unproject.projections.base import Projection
from unproject.projections.line_integral import directions
from unproject.projections.observation import Observation
from unproject.projections.priors import Product, Uniform
from unproject.training import Adam, Recipe, train
from unproject.training.evaluation import assigned_panel
from unproject.training.panel import build_panels


def test_draws_follow_the_shares() -> None:
    distribution = WayDistribution(4)
    wanted = torch.tensor([0.5, 0.3, 0.15, 0.05])
    distribution.logits.data = wanted.log() + 3
    torch.testing.assert_close(distribution.shares, wanted)
    for temperature in (0.1, 2.0):
        u = distribution.relaxed(20_000, temperature, generator_at(0))
        torch.testing.assert_close(u.sum(1), torch.ones(20_000))
        drawn = torch.bincount(u.argmax(1), minlength=4) / 20_000
        assert (drawn - wanted).abs().max() < 0.015  # four standard errors
    assert u.max(1).values.mean() < 0.9 < distribution.relaxed(100, 0.02, generator_at(0)).max(1).values.mean()


def test_unevenness_is_what_the_entropy_lacks() -> None:
    distribution = WayDistribution(5)
    assert distribution.unevenness().item() == pytest.approx(0, abs=1e-6)
    distribution.logits.data = torch.tensor([100.0, 0, 0, 0, 0])
    assert distribution.unevenness().item() == pytest.approx(torch.tensor(5.0).log().item(), rel=1e-5)


def shifted(x: Tensor, way: Tensor) -> Tensor:
    return x * (way + 1.0)[:, None]


def test_what_is_seen_is_the_hard_draw_and_the_gradient_is_that_of_all_looks() -> None:
    x = torch.rand(6, 3, generator=generator_at(0)).requires_grad_()
    u = torch.rand(6, 4, generator=generator_at(1)).requires_grad_()
    seen = look_softly(shifted, x, u, 4)
    way = u.argmax(1)
    torch.testing.assert_close(seen, shifted(x, way))
    weight = torch.rand(6, 3, generator=generator_at(2))
    by_x, by_u = torch.autograd.grad((seen * weight).sum(), (x, u))
    torch.testing.assert_close(by_x, weight * (way + 1.0)[:, None])
    expected = (weight * x.detach()).sum(1)[:, None] * torch.arange(1.0, 5)
    expected[4:] = 0
    torch.testing.assert_close(by_u, expected)


class Constant(Generator):
    """One thing, of which everything is known but the views."""

    def __init__(self) -> None:
        super().__init__(1)
        self.unused = nn.Parameter(torch.zeros(1))

    def forward(self, code: Tensor) -> Tensor:
        image = torch.zeros(len(code), 1, 16, 16)
        image[:, :, 2:6, 3:9] = 1
        image[:, :, 8:14, 10:12] = 0.7
        return image + 0 * self.unused


TRUE = torch.tensor([0.6, 0.05, 0.25, 0.1])
WAYS = directions(4, 0.1)


def recipe(**changes: object) -> Recipe:
    which = torch.multinomial(TRUE, 600, replacement=True, generator=generator_at(5))
    collection = Collection(torch.zeros(600, 1, 16))
    looks = [(way, collection) for way in WAYS]
    panel = build_panels(Recipe(Constant, looks, LearnedPrior(), partial(Discriminator, channels=4), steps=1))[0]
    seen = Collection(panel.look(Constant()(torch.zeros(600, 1)).detach(), which, generator_at(6)))
    made = Recipe(
        Constant,
        [(way, seen) for way in WAYS],
        LearnedPrior(rate=0.02, evenness=0.0),
        partial(Discriminator, channels=8, shared=4, bottleneck=32),
        penalty=R1R2(0.01, every=4),
        generator_optimiser=Adam(1e-3),
        discriminator_optimiser=Adam(3e-3),
        batch=64,
        steps=300,
    )
    return made.replace(**changes)  # type: ignore[arg-type]


def test_it_finds_how_often_each_view_was_taken(tmp_path: Path) -> None:
    """The mutant gives the distribution no gradient: it stays uniform, 0.35 from the truth."""
    run = train(recipe(), tmp_path / "run", quiet=True)
    lines = [json.loads(line) for line in (run.path / "stats.jsonl").read_text().splitlines()]
    shares = [torch.tensor(line["ways"]) for line in lines if "ways" in line]
    found = torch.stack(shares[-10:]).mean(0)
    assert (found - TRUE).abs().max() < 0.12, found
    panel = assigned_panel(run, recipe())
    assert panel.distribution is not None and torch.allclose(panel.distribution.shares, shares[-1], atol=1e-3)
    assert (torch.bincount(panel.ways, minlength=4) / 600 - shares[-1]).abs().max() < 0.1
    assert (torch.full((4,), 0.25) - TRUE).abs().max() > 0.3


def test_evenness_draws_it_to_the_uniform_one(tmp_path: Path) -> None:
    run = train(recipe(assignment=LearnedPrior(rate=0.02, evenness=10.0), steps=100), tmp_path / "run", quiet=True)
    last = json.loads((run.path / "stats.jsonl").read_text().splitlines()[-1])
    assert max(last["ways"]) < 0.3


class Doubled(Projection):
    """Another projection."""

    def forward(self, x: Tensor, *, angle: Tensor) -> Tensor:  # type: ignore[override]
        return x.mean(2) * (1 + 0 * angle[:, None, None])


def test_looks_that_cannot_share_a_prior() -> None:
    seen = Collection(torch.rand(4, 1, 16))
    other = Observation("other", Doubled(), Uniform("angle", 0, 1))
    for looks in ([(WAYS[0], seen)], [(WAYS[0], seen), (other, seen)]):
        with pytest.raises(UserError, match="LearnedPrior assignment: give at least two looks"):
            build_panels(recipe(looks=looks))
    with pytest.raises(UserError, match="LearnedPrior assignment: every observation"):
        build_panels(recipe(looks=[(WAYS[0], seen), (WAYS[1], Collection(torch.rand(4, 1, 16)))]))
    assert Product().names == ()


@pytest.mark.parametrize("wrong", [{"rate": 0}, {"temperature": 0}, {"images": 0}, {"evenness": -1}])
def test_settings_that_make_no_sense(wrong: dict[str, float]) -> None:
    with pytest.raises(UserError, match="positive rate"):
        LearnedPrior(**wrong)  # type: ignore[arg-type]
