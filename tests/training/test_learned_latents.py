"""Learned latents: training moves them, a killed run resumes bit for bit, and --from takes them over."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from comparing import differences, final, stats
from torch import Tensor
from toy import jointly, toy, with_panel

from unproject.assignment import LearnedLatent
from unproject.domains import Domain
from unproject.networks import Generator, LowRankGenerator
from unproject.training import Recipe, load, resume, train
from unproject.training.description import describe
from unproject.training.start import start_from
from unproject.training.state import State
from unproject.training.trainer import Trainer

ELEVATION = LearnedLatent("elevation", mean=0.2, spread=0.1, low=-0.5, high=1.2)


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Domain, "write_preview", lambda *_: None)


def tilted(recipe: Recipe) -> Recipe:
    return with_panel(recipe, learned=(ELEVATION,))


def test_a_panel_without_them_is_described_as_ever() -> None:
    """Or runs of every other recipe could not be resumed."""
    with_some, without = (describe(recipe.panels[0]) for recipe in (tilted(toy()), toy()))
    assert len(with_some["learned"]) == 1 and "learned" not in without
    assert not any("learned" in name for name in State(toy(), torch.device("cpu")).tensors())


@pytest.mark.parametrize("views", ["predicted", "single", "learned", "joint"])
def test_training_moves_them(views: str, tmp_path: Path) -> None:
    recipe = jointly(toy(steps=4)) if views == "joint" else toy(steps=4, views=views)  # type: ignore[arg-type]
    run = train(tilted(recipe), tmp_path / "run", quiet=True)
    found = final(run.path)
    assert found["panels/0/assignment/learned.latents.elevation.mean"].item() != pytest.approx(0.2, abs=1e-6)
    mean, spread = stats(run.path)[-1]["elevation"]
    assert 0 < abs(mean - 0.2) < 0.02 and 0 < abs(spread - 0.1) < 0.02


def test_a_killed_run_resumes_bit_for_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recipe = tilted(jointly(toy(steps=6, checkpoint_every=2)))
    whole = train(recipe, tmp_path / "whole", quiet=True).path
    update, calls = Trainer._update_generator, 0

    def kill_in_the_fourth(*arguments: object) -> torch.Tensor:
        nonlocal calls
        calls += 1
        if calls == 4:
            raise KeyboardInterrupt
        return update(*arguments)  # type: ignore[arg-type]

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "_update_generator", kill_in_the_fourth)
        with pytest.raises(KeyboardInterrupt):
            train(recipe, tmp_path / "killed", quiet=True)
    assert resume(tmp_path / "killed", recipe, quiet=True).step == 6
    assert differences(whole, tmp_path / "killed") == []


def test_until_they_begin_priors_draw(tmp_path: Path) -> None:
    """Nothing is spent on them before; a resumed run goes on where it was."""
    recipe = with_panel(toy(steps=8), learned=(replace(ELEVATION, begin=0.5),))
    run = train(recipe, tmp_path / "run", quiet=True)
    seen = {line["step"]: line.get("elevation") for line in stats(run.path) if "loss_d" in line}
    assert seen[2] is None and seen[4] is None and seen[6] is not None and seen[6] != seen[8]
    level = train(toy(steps=8), tmp_path / "level", quiet=True)
    losses = [[line["loss_g"] for line in stats(one.path) if "loss_g" in line] for one in (run, level)]
    assert losses[0][:2] == losses[1][:2] and losses[0][2:] != losses[1][2:]
    begun = run.assignments()[0].learned
    assert begun is not None and "elevation" in begun.draw(1, torch.Generator())


def test_another_run_gives_what_it_learned(tmp_path: Path) -> None:
    recipe = with_panel(toy(steps=4), learned=(replace(ELEVATION, begin=0.5),))
    old = train(recipe, tmp_path / "old", quiet=True).path
    state = State(recipe, torch.device("cpu"))
    noted = start_from(state, old)
    assert noted["panels"][0]["learned"] == ["elevation"]
    key = "panels/0/assignment/learned.latents.elevation.mean"
    assert torch.equal(state.tensors()[key], final(old)[key])
    learned = state.panels[0].assignment.learned
    assert learned is not None
    learned.advance(0.0)
    assert "elevation" in learned.draw(1, torch.Generator()), "a generator of tilted views does not begin level again"
    level = State(toy(steps=4), torch.device("cpu"))
    assert "learned" not in start_from(level, old)["panels"][0]


@pytest.mark.parametrize(("elevation", "hull"), [(0.02, True), (-0.02, True), (0.3, False), (-0.3, False)])
def test_hulls_are_sampled_of_level_cameras_only(elevation: float, hull: bool, tmp_path: Path) -> None:
    """From above a camera sees concavities; as trained and as loaded."""
    latent = LearnedLatent("elevation", elevation, spread=0.02)
    recipe = with_panel(toy(steps=1), learned=(latent,))
    recipe = recipe.replace(generator=partial(LowRankGenerator, size=16, channels=8, rank=4, code_size=8, hull=True))
    run = train(recipe, tmp_path / "run", quiet=True)
    assert run.generator.hull is load(run.path).generator.hull is hull


def test_hulls_are_sampled_until_elevations_begin_and_of_previews_alike(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[bool | float] = []

    def sample(generator: Generator, *_: Any, **__: Any) -> Tensor:
        drawn.append(generator.hull)
        return torch.zeros(1)

    monkeypatch.setattr(Generator, "sample", sample)
    recipe = with_panel(toy(steps=4, checkpoint_every=2), learned=(replace(ELEVATION, begin=0.6),))
    recipe = recipe.replace(generator=partial(LowRankGenerator, size=16, channels=8, rank=4, code_size=8, hull=2.0))
    run = train(recipe, tmp_path / "run", quiet=True)
    assert drawn == [2.0, False] and run.generator.hull is False
