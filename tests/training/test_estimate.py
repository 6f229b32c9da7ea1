"""Memory and seconds of a step, estimated before it is taken.

Peak resident memory of nine steps less what was resident before, against the estimate, on one thread (2026-11-23):

| recipe       | size | estimate / GiB | measured / GiB | ratio |
|--------------|------|----------------|----------------|-------|
| digits       | 32   | 0.14           | 0.15           | 0.91  |
| digits       | 64   | 0.16           | 0.16           | 1.04  |
| shapes       | 32   | 0.42           | 0.34           | 1.23  |
| shapes       | 64   | 1.15           | 1.12           | 1.03  |
| wood         | 32   | 0.16           | 0.21           | 0.77  |
| wood         | 64   | 0.35           | 0.65           | 0.54  |
| shapes-paper | 32   | 2.82           | 2.62           | 1.08  |

Shapes with 8 chairs and 4 views each, wood with 16 images an observation, shapes-paper with batch 16 and 64 channels.
What the compiled renderer allocates itself is not counted.
"""

from __future__ import annotations

import pytest
import torch
from toy import toy

from unproject._types import UserError
from unproject.recipes.digits import digits
from unproject.recipes.shapes import shapes
from unproject.training import memory
from unproject.training.estimate import (
    MODULES,
    Peak,
    Trial,
    estimate,
)
from unproject.training.memory import available_memory, require_memory_to_train, unchecked

CPU = torch.device("cpu")


def test_what_is_alive_at_once_is_counted() -> None:
    with Peak() as peak:
        a = torch.ones(1000)
        b = a + 1
        del a
        c = b * 2
        view = c.view(10, 100)
        view.add_(1)
    assert peak.most == 8000 and len(c) == 1000


def test_more_than_the_limit_ends_a_trial() -> None:
    trial = Trial(toy(views="known"), CPU, 10**5)
    assert trial.measured(trial.step, 2)[0] < 10**6 and trial.full


@pytest.mark.parametrize("views", ["predicted", "known", "learned", "single", "direct"])
def test_memory_grows_with_the_batch(views: str) -> None:
    recipe = toy(views=views, batch=64)  # pyright: ignore[reportArgumentType]
    few, many = (estimate(recipe.replace(batch=batch), CPU) for batch in (256, 2048))
    fixed = MODULES + 4 * Trial(recipe, CPU, None).weights
    least = 1.05 if views == "predicted" else 1.5  # a view predictor projects as many images whatever the batch
    assert least < (many.memory - fixed) / (few.memory - fixed) < 8.1


def test_an_estimate_leaves_the_recipe_and_its_draws_alone() -> None:
    torch.manual_seed(0)
    before = torch.get_rng_state()
    estimate(digits(size=16, steps=2), CPU)
    assert torch.equal(torch.get_rng_state(), before)


def test_available_memory_is_what_the_system_says() -> None:
    there = available_memory(CPU)
    assert there is None or 2**20 < there < 2**50


def test_what_does_not_fit_is_refused_unless_forced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "available_memory", lambda device: 2**30)
    require_memory_to_train(2**30, "a step takes", "lower --size")
    with pytest.raises(UserError, match=r"a step takes about 2.0 GB and 1.0 GB are available; lower --size, or add"):
        require_memory_to_train(2**31, "a step takes", "lower --size")
    with unchecked():
        require_memory_to_train(2**31, "a step takes", "lower --size")
    monkeypatch.setattr(memory, "available_memory", lambda device: None)
    require_memory_to_train(2**60, "a step takes", "lower --size")


def test_a_trial_of_what_is_far_too_large_is_short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "available_memory", lambda device: 2**24)
    monkeypatch.setattr("unproject.recipes.shape_panels.require_memory_to_train", lambda *_: None)
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 2)
    recipe = shapes(size=64, views_per_shape=1, steps=2)
    assert estimate(recipe, CPU).memory > 2**24


def test_all_updates_of_discriminators_count_where_a_trial_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.training.memory.available_memory", lambda _: 2 * 10**5)
    monkeypatch.setattr(Trial, "measured", lambda self, *_: setattr(self, "full", True) or (10**5, 1.0))
    recipe = toy(views="known", batch=8)
    once, thrice = (estimate(recipe.replace(discriminator_steps=n), CPU).seconds for n in (1, 3))
    assert thrice == 3 * once
