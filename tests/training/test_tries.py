"""Tries: the best of several starts goes on, as it was, and a run that is killed among them resumes bit for bit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from comparing import differences, final, stats
from torch import Tensor
from toy import only_panel, toy, with_panel, with_predicted

from unproject._types import UserError
from unproject.adversarial.adaptive import Adaptive
from unproject.adversarial.augmentation import Affine
from unproject.assignment import PredictedState
from unproject.domains import Domain
from unproject.projections.observation import Observation
from unproject.training import Tries, resume, train, trainer
from unproject.training.health import Diverged, check
from unproject.training.recorder import Recorder
from unproject.training.state import State
from unproject.training.trainer import Trainer

RECIPE = toy(steps=12, checkpoint_every=2, starts=(0.1, 0.3, 0.7)).replace(tries=Tries(3, 0.2, least_steps=1))


class Killed(BaseException):
    """Stands for SIGKILL where the instant must be exact."""


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Domain, "write_preview", lambda *_: None)
    monkeypatch.setattr(trainer, "EVERY", 2)


def merits(monkeypatch: pytest.MonkeyPatch, *values: float) -> None:
    """What each try ends with."""
    left: Iterator[float] = iter(values)
    monkeypatch.setattr(PredictedState, "merit", lambda _: next(left))


@pytest.mark.parametrize("best, values", [(0, (0.9, 0.5, 0.8)), (1, (0.1, 0.7, 0.7)), (2, (0.1, 0.0, 0.2))])
def test_the_best_goes_on_as_it_was(
    best: int, values: tuple[float, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Weights, moments, averages and assignments; the counters go on."""
    merits(monkeypatch, *values)
    ends: list[dict[str, Tensor]] = []
    again, take = State.begin_again, State.take_kept
    monkeypatch.setattr(State, "begin_again", lambda s, *given: (ends.append(s.tensors()), again(s, *given)))

    def taken(state: State, progress: float) -> None:
        ends.append(state.tensors())
        take(state, progress)
        now = state.tensors()
        assert set(now) == {name for name in ends[best] if not name.startswith("kept/")}
        for name, value in now.items():
            expected = ends[-1] if name.startswith("counters/") else ends[best]
            assert torch.equal(value, expected[name]) or name == "counters/start", name
        assert state.counters.start == best

    monkeypatch.setattr(State, "take_kept", taken)
    run = train(RECIPE, tmp_path / "run", quiet=True)
    assert len(ends) == 3 and run.step == 12
    weights = [end["generator/bias"] if "generator/bias" in end else next(iter(end.values())) for end in ends]
    assert not torch.equal(weights[0], weights[1]) and not torch.equal(weights[1], weights[2])
    tried = [line for line in stats(run.path) if line.get("event") == "tried"]
    assert [line["merit"] for line in tried] == list(values) and [line["number"] for line in tried] == [0, 1, 2]
    assert [line["step"] for line in tried] == [3, 5, 8]


@pytest.mark.parametrize(
    "values, best", [((math.nan, 0.5, 0.8), 2), ((0.1, math.inf, -0.2), 0), ((-0.3, -0.2, math.nan), 1)]
)
def test_a_try_whose_merit_is_not_finite_is_not_kept(
    values: tuple[float, ...], best: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    merits(monkeypatch, *values)
    run = train(RECIPE, tmp_path, quiet=True)
    tried = [line for line in stats(run.path) if line.get("event") == "tried"]
    assert [line["merit"] for line in tried] == [value if math.isfinite(value) else None for value in values]
    assert not any(line.get("event") == "rollback" for line in stats(run.path))
    found = final(run.path)
    assert found["counters/best_start"] == best and found["counters/best_merit"].item() == pytest.approx(values[best])


@pytest.mark.parametrize("of_views", [True, False])
def test_a_try_whose_weights_broke_is_not_kept(of_views: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Be it that its views are as well known as ever: those of the first, which turns NaN in its last step."""
    monkeypatch.setattr(trainer, "EVERY", 100)
    if not of_views:
        merits(monkeypatch, 0.9, 0.5, 0.8)
    update, calls = Trainer._update_generator, iter(range(1, 100))  # pyright: ignore[reportPrivateUsage]

    def broken(self: Trainer, *arguments: Any) -> Tensor:
        loss = update(self, *arguments)
        if next(calls) == 3:
            for module in (self.state.generator, *(panel.assignment for panel in self.state.panels)):
                next(module.parameters()).data.fill_(math.nan)
        return loss

    monkeypatch.setattr(Trainer, "_update_generator", broken)
    run = train(RECIPE.replace(checkpoint_every=4), tmp_path, quiet=True)
    assert [line["event"] for line in stats(run.path) if line.get("event") in ("tried", "rollback")] == ["tried"] * 3
    assert final(run.path)["counters/best_start"] > 0


def test_tries_that_all_break_end_the_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    merits(monkeypatch, *[math.nan] * 3)
    with pytest.raises(Diverged, match="broke down in all 3 tries; lower the learning rate"):
        train(RECIPE.replace(checkpoint_every=100), tmp_path, quiet=True)


def test_losses_begin_anew_and_count_the_budget_from_there() -> None:
    """The strength of an augmentation moves by what has passed since, not by the tries between."""
    train_on, held_out = only_panel(RECIPE).collections[0].split(0.3)
    recipe = with_panel(RECIPE, data=train_on, held_out=held_out).replace(augmentation=Adaptive(Affine(), rise=0.2))
    state = State(recipe, torch.device("cpu"))
    (panel,) = state.panels

    def strength(progress: float) -> float:
        assert panel.augmentation is not None
        panel.augmentation.adapt(train=1.0, held_out=-0.5, generated=-1.0, progress=progress)
        return panel.augmentation.log()["strength"]

    assert strength(0.02) == 0.1
    panel.gradient_norm = 3.0
    state.keep(1.0)
    state.begin_again(1, 0.06)
    assert strength(0.07) == 0.05 and panel.gradient_norm == 0
    state.take_kept(0.12)
    assert strength(0.14) == 0.2 and panel.gradient_norm == 3.0


@pytest.mark.parametrize("killed_at", [2, 4, 6, 9, 11])
def test_killed_among_tries(killed_at: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = train(RECIPE, tmp_path / "whole", quiet=True).path
    update, calls = Trainer._update_generator, 0  # pyright: ignore[reportPrivateUsage]

    def deadly(self: Trainer, *arguments: Any) -> Tensor:
        nonlocal calls
        calls += 1
        if calls == killed_at:
            raise Killed
        return update(self, *arguments)

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "_update_generator", deadly)
        with pytest.raises(Killed):
            train(RECIPE, tmp_path / "run", quiet=True)
    if (tmp_path / "run" / "checkpoints").exists():
        resume(tmp_path / "run", RECIPE, quiet=True)
        assert differences(whole, tmp_path / "run") == []


def test_each_try_has_initial_views(tmp_path: Path) -> None:
    def initialiser(observations: Sequence[Observation], items: Tensor, seed: int) -> Tensor:
        return torch.eye(len(observations)).repeat(len(items), 1)[: len(items)]

    late = with_predicted(toy(steps=12, starts=(0.9,)), initialiser=initialiser)
    run = train(late.replace(tries=Tries(3, 0.2, least_steps=1)), tmp_path / "run", quiet=True)
    assert [line["step"] for line in stats(run.path) if line.get("event") == "initialised"] == [0, 3, 5]


def test_a_start_too_short_to_tell_goes_on(tmp_path: Path) -> None:
    short = RECIPE.replace(tries=Tries(3, 0.2, least_steps=4))
    one = train(short, tmp_path / "short", quiet=True).path
    none = train(RECIPE.replace(tries=None), tmp_path / "none", quiet=True).path
    assert not [line for line in stats(one) if line.get("event") == "tried"]
    assert [d for d in differences(one, none) if d not in ("counters/tried",)] == []


def test_a_larger_budget_has_no_further_tries(tmp_path: Path) -> None:
    train(RECIPE, tmp_path, quiet=True)
    resume(tmp_path, RECIPE, steps=24, quiet=True)
    assert [line["step"] for line in stats(tmp_path) if line.get("event") == "tried"] == [3, 5, 8]


def test_the_merit_of_predicted_views_is_their_information(tmp_path: Path) -> None:
    run = train(RECIPE, tmp_path / "run", quiet=True)
    (state,) = run.assignments()
    assert state.merit() == pytest.approx(state.checks()["view_information"].value)
    assert toy(views="known").panels[0].assignment.begin(toy(views="known").panels[0], 0).merit() == 0


def test_a_new_try_has_time_to_vary() -> None:
    losses = {"loss_d": 1.0}
    assert check(400, losses, 0.0, 3) == 4 and check(400, losses, 0.0, 3, began=200) == 0


@pytest.mark.parametrize(
    "wrong", [{"count": 0}, {"share": 0.0}, {"count": 4, "share": 0.25}, {"least_steps": 0}], ids=str
)
def test_tries_that_cannot_be_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UserError, match="at least one try"):
        Tries(**wrong)


def test_losses_of_new_networks_are_balanced_by_norms_of_their_own(tmp_path: Path) -> None:
    """They are measured at the first step of a try and after a restart, whatever the period."""
    panels = toy(views="known").panels
    recipe = toy(views="known", steps=9).replace(panels=[*panels, replace(panels[0], weight=0.5)], balance_every=1000)
    with Recorder(tmp_path, quiet=True) as recorder:
        trainer = Trainer(recipe, tmp_path, recorder)

        def stepped() -> list[float]:
            trainer.step()
            return [panel.gradient_norm for panel in trainer.state.panels]

        first = stepped()
        assert stepped() == first and min(first) > 0
        trainer.state.begin_again(1, 0.2)
        trainer.forward = trainer.state.generator
        second = stepped()
        assert min(second) > 0 and second != first
        trainer.restart()
        third = stepped()
        assert min(third) > 0 and third != second
