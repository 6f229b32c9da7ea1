"""Learned latents: training moves them, a killed run resumes bit for bit, and --from takes them over."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import torch
from comparing import differences, final, stats
from toy import jointly, toy, with_panel

from unproject.assignment import LearnedLatent
from unproject.domains import Domain
from unproject.networks import LowRankGenerator
from unproject.training import Recipe, Tries, load, resume, train
from unproject.training.start import start_from
from unproject.training.state import State
from unproject.training.trainer import Trainer

ELEVATION = LearnedLatent("elevation", mean=0.2, spread=0.1, low=-0.5, high=1.2)


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Domain, "write_preview", lambda *_: None)


def tilted(recipe: Recipe) -> Recipe:
    return with_panel(recipe, learned=(ELEVATION,))


@pytest.mark.parametrize("views", ["predicted", "single", "learned", "joint"])
def test_training_moves_them(views: str, tmp_path: Path) -> None:
    recipe = jointly(toy(steps=4)) if views == "joint" else toy(steps=4, views=views)  # type: ignore[arg-type]
    run = train(tilted(recipe), tmp_path / "run", quiet=True)
    found = final(run.path)
    assert found["panels/0/assignment/learned.elevation.mean"].item() != pytest.approx(0.2, abs=1e-6)
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


def test_tries_begin_with_other_distributions(tmp_path: Path) -> None:
    """The one that goes on keeps its own, after a resume too."""
    latent = replace(ELEVATION, others=((-0.3, 0.05),), rate=1e-6)
    tries = Tries(3, 0.25, least_steps=1)
    recipe = with_panel(toy(steps=8, starts=(0.05, 0.3, 0.55)), learned=(latent,)).replace(tries=tries)
    run = train(recipe, tmp_path / "run", quiet=True)
    lines = stats(run.path)
    tried = {line["number"]: line["step"] for line in lines if line.get("event") == "tried"}
    seen = [line["elevation"] for line in lines if "elevation" in line and line["step"] <= tried[2]]
    assert seen == [[0.2, 0.1], [-0.3, 0.05], [0.2, 0.1]]
    assert resume(run.path, recipe, steps=10, quiet=True).step == 10


def test_another_run_gives_what_it_learned(tmp_path: Path) -> None:
    recipe = tilted(toy(steps=4))
    old = train(recipe, tmp_path / "old", quiet=True).path
    state = State(recipe, torch.device("cpu"))
    noted = start_from(state, old)
    assert noted["panels"][0]["learned"] == ["elevation"]
    key = "panels/0/assignment/learned.elevation.mean"
    assert torch.equal(state.tensors()[key], final(old)[key])
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
