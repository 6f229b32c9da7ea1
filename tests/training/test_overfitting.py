"""Held-out images: never trained on, scored under heads of their own, and what the augmentation's strength follows."""

from __future__ import annotations

import json
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from comparing import differences, final, stats
from torch import Tensor, nn
from toy import BINS, only_panel, toy, with_predicted

from unproject._types import UserError
from unproject.adversarial import Adaptive, Augmentation, Penalty, Shift
from unproject.adversarial.penalties import Discriminate
from unproject.assignment import AssignmentState, Known, Panel, Predicted, PredictorFit
from unproject.data import Collection
from unproject.domains import Domain
from unproject.networks import Discriminator
from unproject.recipes.pairing import Views, panel_of
from unproject.training import Recipe, resume, train
from unproject.training.description import describe
from unproject.training.health import Diverged
from unproject.training.recorder import Recorder
from unproject.training.recovery import roll_back
from unproject.training.state import State
from unproject.training.trainer import Trainer

ALL = only_panel(toy()).collections[0]
TRAIN, HELD_OUT = ALL.split(0.25, seed=0)
ADAPTIVE = Adaptive(Shift(2.0), every=2, rise=0.5, start=0.5)
CPU = torch.device("cpu")


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Domain, "write_preview", lambda *_: None)


def adaptive(views: Views = "known", augmentation: Augmentation = ADAPTIVE, **settings: Any) -> Recipe:
    """The toy on three quarters of its shapes."""
    recipe = toy(views=views, **{"steps": 8, "checkpoint_every": 2, **settings})
    panel = only_panel(toy())
    predicted = recipe.panels[0].assignment if views == "predicted" else None
    assert predicted is None or isinstance(predicted, Predicted)
    made = panel_of(views, panel.observations, TRAIN, predicted, held_out=HELD_OUT)
    return replace(recipe, panels=[made], augmentation=augmentation)


def test_held_out_images_are_scored_with_their_heads_and_not_trained_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every second update; marked by a value that only they have, and by another once augmented."""
    scored: list[tuple[Tensor, Tensor]] = []
    forward = Discriminator.forward

    def noted(discriminator: Discriminator, image: Tensor, head: Tensor) -> Tensor:
        if image.max() > 4:
            assert not torch.is_grad_enabled() and image.min() > 8
            scored.append((image - 10, head))
        return forward(discriminator, image, head)

    class Added(Augmentation):
        def __call__(self, images: Tensor, rng: torch.Generator) -> Tensor:
            return images + 5 * (images.amax((1, 2, 3), keepdim=True) > 4)

    monkeypatch.setattr(Discriminator, "forward", noted)
    recipe = adaptive(augmentation=Adaptive(Added(), every=2, rise=1e9, start=1.0, most=1.0))
    marked = Collection(HELD_OUT.floats() + 5, names=HELD_OUT.names, latents=HELD_OUT.latents)
    recipe = replace(recipe, panels=[replace(recipe.panels[0], held_out=marked)])
    train(recipe, tmp_path, quiet=True)
    assert len(scored) == 4 and not torch.equal(scored[0][0], scored[1][0])
    views = (HELD_OUT.latents or {})["view"]
    for image, head in scored:
        rows = [int((HELD_OUT.floats() - one).abs().amax((1, 2, 3)).argmin()) for one in image]
        assert torch.equal(head, views[rows].long())


def test_the_strength_follows_what_the_discriminator_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of training images 1, of held-out ones 0 and of generated ones -1: r = 1/2."""
    calls = [torch.ones(4), -torch.ones(4)]
    forward = Discriminator.forward

    def said(discriminator: Discriminator, image: Tensor, head: Tensor) -> Tensor:
        values = torch.cat(calls) if len(image) == 8 else torch.zeros(len(image))
        return values + 0 * forward(discriminator, image, head)

    monkeypatch.setattr(Discriminator, "forward", said)
    train(adaptive(augmentation=replace(ADAPTIVE, start=0.0)), tmp_path, quiet=True)
    lines = [line for line in stats(tmp_path) if "loss_d" in line]
    # measured after 1, 3, 5 and 7 of 8 steps; 0 to 1 within half of the budget, to 0.8 at most
    assert [line["strength"] for line in lines] == [0.25, 0.75, 0.8, 0.8]
    assert [line["overfitting"] for line in lines] == [0.5] * 4


def test_the_penalty_is_scaled_by_the_panel_and_by_its_augmentation(tmp_path: Path) -> None:
    class Constant(Penalty):
        every = 1

        def __call__(self, discriminator: Discriminate, real: Tensor, fake: Tensor, rng: torch.Generator) -> Tensor:
            return torch.ones((), requires_grad=True)

    grown = replace(ADAPTIVE, start=ADAPTIVE.most, rise=1e9, penalty=3.0)
    recipe = replace(adaptive(augmentation=grown, steps=2), penalty=Constant())
    recipe = replace(recipe, panels=[replace(recipe.panels[0], penalty_scale=2.0)])
    train(recipe, tmp_path, quiet=True)
    assert [line["penalty"] for line in stats(tmp_path) if "penalty" in line] == pytest.approx([6.0])


@pytest.mark.parametrize("views", ["known", "predicted"])
def test_the_strength_goes_on_where_it_was(tmp_path: Path, views: Views) -> None:
    recipe = adaptive(views, replace(ADAPTIVE, rise=4.0, penalty=3.0))
    whole = train(recipe, tmp_path / "whole", quiet=True).path
    with pytest.MonkeyPatch.context() as patch:
        step, calls = Trainer.step, iter(range(100))

        def killed(trainer: Trainer) -> None:
            if next(calls) == 5:
                raise KeyboardInterrupt
            step(trainer)

        patch.setattr(Trainer, "step", killed)
        with suppress(KeyboardInterrupt):
            train(recipe, tmp_path / "killed", quiet=True)
    resume(tmp_path / "killed", recipe, quiet=True)
    assert differences(whole, tmp_path / "killed") == []
    assert final(whole)["panels/0/augmentation/strength"].item() not in (0.0, 0.5)


def test_the_strength_does_not_leap_with_a_smaller_budget(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 80 steps 4 are done, then of 10: the measurement at 5 moves it by a tenth, not by nearly a half."""
    recipe, step = adaptive(augmentation=replace(ADAPTIVE, rise=1.0)), Trainer.step
    with monkeypatch.context() as patch, pytest.raises(ZeroDivisionError):
        patch.setattr(Trainer, "step", lambda self: step(self) if self.state.counters.step < 4 else 1 / 0)
        train(recipe.replace(steps=80), tmp_path, quiet=True)
    resume(tmp_path, recipe.replace(steps=10), quiet=True)
    strengths = {line["step"]: line["strength"] for line in stats(tmp_path) if "strength" in line}
    assert abs(strengths[6] - strengths[4]) == pytest.approx(0.1)


def test_the_strength_does_not_leap_with_a_rollback_in_a_budget_of_minutes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was trained in vain is spent, and says nothing of overfitting."""
    recipe = adaptive(augmentation=replace(ADAPTIVE, rise=1.0)).replace(steps=None, minutes=10.0)
    train(recipe.replace(steps=4), tmp_path, quiet=True)
    with Recorder(tmp_path, quiet=True) as recorder:
        trainer = Trainer(recipe, tmp_path, recorder)
        trainer.state.counters.seconds = 300.0
        roll_back(trainer, Diverged("broke down"))
        (panel,) = trainer.state.panels
        assert panel.augmentation is not None and trainer.state.counters.step == 4
        assert panel.augmentation.state_dict()["moved_at"].item() == pytest.approx(0.5, abs=0.01)


def view_of(images: Tensor) -> Tensor:
    """A view that changes from image to image."""
    return (images.sum((1, 2, 3)) * 100).long() % BINS


def test_predicted_views_of_held_out_images_are_predicted_with_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each has the head of the view that the predictor gives it, as the training images have."""

    def probabilities(fit: PredictorFit, predictor: nn.Module, batches: Iterable[Tensor]) -> Tensor:
        return torch.eye(BINS)[torch.cat([view_of(part) for part in batches])]

    monkeypatch.setattr(PredictorFit, "probabilities", probabilities)
    recipe = with_predicted(adaptive("predicted", draw="argmax", steps=4), rounds={"starts": (0.3,)})
    run = train(recipe, tmp_path, quiet=True)
    tensors = final(tmp_path)
    assert torch.equal(tensors["panels/0/assignment/heads"], view_of(TRAIN.floats()))
    assert torch.equal(tensors["panels/0/assignment/held_out_heads"], view_of(HELD_OUT.floats()))
    assert torch.equal(tensors["panels/0/assignment/views"], tensors["panels/0/assignment/heads"])
    assert run.assignments()[0].checks()["view_information"].n == len(TRAIN)


@pytest.mark.parametrize("views", ["learned", "single", "predicted"])
def test_one_head_scores_them_while_views_are_unknown(views: Views) -> None:
    assignment: AssignmentState = State(adaptive(views), CPU).panels[0].assignment
    assert assignment.held_out_heads.tolist() == [0] * len(HELD_OUT)


def test_a_panel_without_held_out_images_is_described_as_ever() -> None:
    with_some, without = (json.loads(json.dumps(describe(r.panels[0]))) for r in (adaptive(), toy(views="known")))
    assert with_some["held_out"]["collection"] == [len(HELD_OUT), 1, 16, 16] and "held_out" not in without
    assert not any("held_out" in name or "augmentation" in name for name in State(toy(), CPU).tensors())


def test_images_of_views_without_others_are_left_out() -> None:
    """They have no head."""
    observations = only_panel(toy()).observations
    view = (TRAIN.latents or {})["view"]
    panel = panel_of("known", observations, TRAIN.subset((view != 1).nonzero()[:, 0]), held_out=HELD_OUT)
    assert len(panel.observations) == BINS - 1 and panel.held_out is not None
    assert 1 not in (panel.held_out.latents or {})["view"].tolist()
    assert isinstance(panel.assignment, Known) and panel.assignment.begin(panel, 0).held_out_heads.max() == BINS - 2


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(UserError, match="differ in size"):
        Panel(only_panel(toy()).observations, TRAIN, held_out=Collection(torch.rand(4, 1, 32, 32)))
    with pytest.raises(UserError, match="give each panel some, Panel"):
        replace(toy(), augmentation=ADAPTIVE)
