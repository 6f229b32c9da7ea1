"""A run that starts from another one has its weights, and does not need it any more."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from comparing import differences, final
from torch import Tensor, nn
from toy import BINS, Layer, only_panel, own, toy, with_predicted

from unproject._types import UserError
from unproject.assignment import PredictorFit
from unproject.cli import main
from unproject.domains import Domain
from unproject.networks import LowRankGenerator
from unproject.recipes import find
from unproject.training import Recipe, Tries, checkpoint, resume, train
from unproject.training.start import differing_settings, settings_of_one, start_from
from unproject.training.state import State
from unproject.training.trainer import Trainer

CPU = torch.device("cpu")
STARTS = (0.5,)


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Domain, "write_preview", lambda *_: None)


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose views were predicted once."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Domain, "write_preview", lambda *_: None)
        return train(toy(steps=4, seed=5, starts=STARTS), tmp_path_factory.mktemp("old") / "run", quiet=True).path


def started(recipe: Recipe, path: Path) -> tuple[State, dict[str, Any]]:
    state = State(recipe, CPU)
    return state, start_from(state, path)


def part(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name: value for name, value in tensors.items() if name.startswith(prefix)}


def test_the_weights_are_those_of_the_other_run_and_all_else_is_new(old: Path) -> None:
    state, noted = started(toy(steps=4, starts=STARTS), old)
    found, there, new = state.tensors(), final(old), State(toy(steps=4), CPU).tensors()
    for prefix in ("generator/", "average/", "discriminators/", "panels/0/assignment/predictor."):
        assert part(found, prefix) and all(torch.equal(there[k], v) for k, v in part(found, prefix).items())
        assert any(not torch.equal(new[k], v) for k, v in part(found, prefix).items())
    assert any(not torch.equal(there[f"average/{k}"], v) for k, v in state.generator.state_dict().items())
    assert not any(part(found, prefix) for prefix in ("generator_optimiser/", "discriminator_optimiser/"))
    assert state.counters.step == 0 and found["panels/0/assignment/round"] == 0
    assert noted["panels"] == [{"discriminator": True, "views": True}] and noted["step"] == 4


def test_how_samples_are_drawn_may_differ(old: Path) -> None:
    recipe = toy(steps=4, starts=STARTS)
    generator = recipe.generator
    assert isinstance(generator, partial)
    started(recipe.replace(generator=partial(generator, hull=2.0)), old)


def test_no_other_try_throws_the_weights_away(old: Path, tmp_path: Path) -> None:
    recipe = toy(steps=4, starts=STARTS).replace(tries=Tries(2, 0.25, least_steps=1))
    tried = [
        [line["event"] for line in train(recipe, tmp_path / name, start=start, quiet=True).stats() if "event" in line]
        for name, start in (("new", None), ("from", old))
    ]
    assert tried[0].count("tried") == 2 and "tried" not in tried[1]


def test_views_are_at_once_those_of_the_other_runs_predictor(old: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Not those of an initialiser, whose gauge need not be the generator's."""
    asked: list[nn.Module] = []

    def probabilities(fit: PredictorFit, predictor: nn.Module, batches: Iterable[Tensor]) -> Tensor:
        asked.append(predictor)
        return torch.eye(BINS)[torch.cat([torch.arange(len(part)) for part in batches]) % BINS]

    def initialiser(*_: Any) -> Tensor:
        raise AssertionError

    monkeypatch.setattr(PredictorFit, "probabilities", probabilities)
    recipe = with_predicted(toy(steps=4, starts=STARTS), initialiser=initialiser)
    state, _ = started(recipe, old)
    assignment: Any = state.panels[0].assignment
    assert asked == [assignment.predictor]
    expected = torch.arange(len(assignment.views)) % BINS
    assert torch.equal(assignment.views, expected) and torch.equal(assignment.heads, expected)

    class Run:
        step, progress = 0, 0.0

    assert assignment.before_step(Run())


def test_a_predictor_that_was_never_fitted_gives_no_views(tmp_path: Path) -> None:
    path = train(toy(steps=2, seed=5, starts=(0.99,)), tmp_path, quiet=True).path
    state, noted = started(toy(steps=4), path)
    fresh = State(toy(steps=4), CPU).panels[0].assignment
    assert noted["panels"] == [{"discriminator": True, "views": False}]
    assert torch.equal(state.panels[0].assignment.views, fresh.views) and not state.panels[0].assignment.heads.any()


def test_a_learned_prior_goes_on(tmp_path: Path) -> None:
    path = train(toy(views="learned", steps=2, seed=5), tmp_path, quiet=True).path
    state, noted = started(toy(views="learned"), path)
    assert noted["panels"] == [{"discriminator": True, "views": True}]
    assert torch.equal(state.tensors()["panels/0/assignment/logits"], final(path)["panels/0/assignment/logits"])


def test_a_discriminator_with_other_heads_is_new(old: Path) -> None:
    state, noted = started(toy(views="single"), old)
    assert noted["panels"] == [{"discriminator": False, "views": False}]
    fresh = State(toy(views="single"), CPU).discriminators.state_dict()
    assert all(torch.equal(fresh[name], value) for name, value in state.discriminators.state_dict().items())
    assert torch.equal(state.generator.state_dict()["bias"], final(old)["generator/bias"])


def test_it_resumes_bit_for_bit_though_the_other_run_is_gone(old: Path, tmp_path: Path) -> None:
    """Killed before its first own checkpoint, whose place the weights at the start take."""
    recipe = toy(steps=4, starts=STARTS)
    other = Path(shutil.copytree(old, tmp_path / "other"))
    whole = train(recipe, tmp_path / "whole", start=other, quiet=True).path
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trainer, "_update_generator", kill)
        with pytest.raises(KeyboardInterrupt):
            train(recipe, tmp_path / "killed", start=str(other), quiet=True)
    shutil.rmtree(other)
    assert [p.name for p in checkpoint.list_checkpoints(tmp_path / "killed/checkpoints")] == [
        "step-000000000.safetensors"
    ]
    assert resume(tmp_path / "killed", recipe, quiet=True).step == 4
    assert differences(whole, tmp_path / "killed") == []
    assert differences(whole, train(recipe, tmp_path / "new", quiet=True).path) != []


def kill(*_: Any) -> None:
    raise KeyboardInterrupt


def test_one_killed_before_its_weights_were_stored_is_refused(
    old: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(checkpoint, "save", kill)
        with pytest.raises(KeyboardInterrupt):
            train(toy(steps=4), tmp_path, start=old, quiet=True)
    with pytest.raises(UserError, match="before its first weights were stored; delete it"):
        resume(tmp_path, toy(steps=4), quiet=True)


def test_recipe_json_says_where_the_weights_come_from(old: Path, tmp_path: Path) -> None:
    """Also those of the run that it started from."""
    first = train(toy(steps=1), tmp_path / "first", start=old, quiet=True).path
    second = train(toy(steps=1), tmp_path / "second", start=first, quiet=True).path
    noted = json.loads((second / "recipe.json").read_text())["start"]
    assert noted["run"] == str(first) and noted["step"] == 1 and noted["arguments"] == {"steps": 1}
    assert noted["start"]["run"] == str(old) and noted["start"]["step"] == 4 and noted["start"]["start"] is None
    assert "start" not in json.loads((old / "recipe.json").read_text())


WIDER = partial(LowRankGenerator, size=16, channels=16, rank=4, code_size=8)
UNNAMED = partial(LowRankGenerator, size=16, channels=8, rank=4)  # another code size, by default


@pytest.mark.parametrize(
    "recipe, words",
    [
        (toy(steps=1).replace(generator=WIDER), "its generator has channels=8, and this recipe's channels=16; give"),
        (
            toy(steps=1).replace(generator=Layer),
            "its generator is unproject.networks.*LowRank.*, and this recipe's toy",
        ),
        (
            toy(steps=1).replace(generator=UNNAMED),
            r"weight .* is \(.*\) there, and \(.*\) in this.*; only that run has code_size=8;",
        ),
    ],
    ids=["settings", "class", "default"],
)
def test_another_architecture_is_refused_before_anything_is_written(
    old: Path, tmp_path: Path, recipe: Recipe, words: str
) -> None:
    with pytest.raises(UserError, match=words):
        train(recipe, tmp_path / "run", start=old, quiet=True)
    assert not (tmp_path / "run").exists()


def test_a_recipe_that_throws_the_weights_away_is_refused(old: Path) -> None:
    with pytest.raises(UserError, match="starts from new weights after round 1"):
        started(toy(restart=True), old)


def test_on_the_command_line_it_is_from(old: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    where = f"{Path(__file__).with_name('toy.py')}:toy"
    words = ["train", where, "--steps", "1", "--quiet", "--out"]
    assert main([*words, str(tmp_path / "run"), "--from", str(old)]) == 0
    assert json.loads((tmp_path / "run/recipe.json").read_text())["start"]["run"] == str(old)
    other = train(own(steps=1), tmp_path / "other", quiet=True).path
    capsys.readouterr()
    assert main([*words, str(tmp_path / "refused"), "--from", str(other)]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"unproject: {other}: cannot start from it: its generator is toy:Layer") and "\n" in said
    assert said.count("\n") == 1 and not (tmp_path / "refused").exists()


def test_only_the_first_panels_heads_count(old: Path) -> None:
    """A second panel has weights of its own, which the other run lacks."""
    recipe = toy(steps=1)
    _, noted = started(recipe.replace(panels=[only_panel(recipe), only_panel(recipe)]), old)
    assert [panel["discriminator"] for panel in noted["panels"]] == [True, False]


def test_averaged_weights_that_were_taken_over_count_their_steps(old: Path) -> None:
    """The average does not forget in ten steps what the other run averaged over."""
    state, _ = started(toy(steps=4, starts=STARTS), old)
    assert state.counters.averaged == 4
    tensors = {**final(old), "counters/averaged": torch.tensor(100.0)}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpoint, "load", lambda *_: tensors)
        assert started(toy(steps=4, starts=STARTS), old)[0].counters.averaged == 104
    for averaged, left in ((0, 1e-3), (10**4, 0.95)):
        state.counters.averaged = averaged
        mean = next(iter(state.average.parameters()))
        mean.data.fill_(1.0)
        next(iter(state.generator.parameters())).data.zero_()
        for step in range(1, 11):
            state.counters.step = step
            state.update_average(300.0)
        assert abs(mean.mean().item() - left) < 0.03 * left + 1e-3


def test_checkpoints_from_before_the_count_are_read(old: Path) -> None:
    tensors = {**final(old), "counters/seconds": torch.zeros(())}
    del tensors["counters/averaged"]
    state = State(toy(steps=4, seed=5, starts=STARTS), CPU)
    state.load(tensors)
    assert state.counters.averaged == 0 and state.counters.step == 4


def test_waves_that_the_other_run_has_not_are_named(tmp_path: Path) -> None:
    small = {"size": 16, "channels": 8, "maps": 4, "renderings": 2, "discriminator_channels": 4, "steps": 1, "batch": 2}
    old = train(find("wood")(**small, waves=False), tmp_path / "old", quiet=True).path
    with pytest.raises(UserError, match=r"weight waves\S* is missing there.*; only this recipe has cycles=4;"):
        start_from(State(find("wood")(**small), CPU), old)


@pytest.mark.parametrize("arguments", [0.5, None, [], "size"])
def test_a_damaged_description_has_no_settings(arguments: object) -> None:
    ours = {"call": "a:B", "arguments": {"size": 16}}
    assert differing_settings({"call": "a:B", "arguments": arguments}, ours) == ""
    assert settings_of_one({"call": "a:B", "arguments": arguments}, ours) == "; only this recipe has size=16"
    assert "size=8" in differing_settings({"call": "a:B", "arguments": {"size": 8}}, ours)
