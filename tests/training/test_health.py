"""A run that goes wrong is noticed, goes back once to its last good checkpoint, and otherwise stops and says why."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest
import torch
from comparing import differences, final, stats
from torch import Tensor
from toy import jointly, toy

from unproject.assignment import Panel
from unproject.cli import main
from unproject.domains import Domain
from unproject.networks import LowRankGenerator
from unproject.projections.silhouette import Silhouette, azimuth_bins
from unproject.training import checkpoint, health, resume, train, trainer
from unproject.training.health import Diverged, check, check_finite, diversity
from unproject.training.trainer import Trainer


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Domain, "write_preview", lambda *_: None)


def breaking(monkeypatch: pytest.MonkeyPatch, *steps: int, where: str = "weights") -> None:
    """Training turns NaN at these steps, counted as taken, so that a repeated step is another one."""
    update, taken = Trainer._update_generator, 0  # pyright: ignore[reportPrivateUsage]

    def broken(self: Trainer, *arguments: Any) -> Tensor:
        nonlocal taken
        loss = update(self, *arguments)
        taken += 1
        if taken in steps and where == "weights":
            with torch.no_grad():
                self.state.generator.bias.fill_(float("nan"))
        return torch.tensor(float("inf")) if taken in steps and where == "loss" else loss

    monkeypatch.setattr(Trainer, "_update_generator", broken)


def events(run: Path) -> list[str]:
    return [line["event"] for line in stats(run) if "event" in line]


@pytest.mark.parametrize("where", ["weights", "loss"])
def test_the_first_time_it_goes_back_with_half_the_rate(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str, capsys: pytest.CaptureFixture[str]
) -> None:
    breaking(monkeypatch, 6, where=where)
    run = train(toy(steps=12, checkpoint_every=4, views="known"), tmp_path, quiet=True)
    tensors = final(tmp_path)
    assert run.step == 12 and tensors["counters/rate_scale"] == 0.5 and tensors["counters/rollbacks"] == 1
    assert all(v.isfinite().all() for v in tensors.values() if v.is_floating_point())
    (rolled,) = [line for line in stats(tmp_path) if line.get("event") == "rollback"]
    assert rolled["step"] == 4 and 6 <= rolled["at"] <= 8 and "step" in rolled["reason"]
    said = " ".join(capsys.readouterr().err.split())
    assert "rolling back to step 4 with half the learning rate" in said


@pytest.mark.parametrize("settings", [{"draw": "posterior"}, {"clusters": 2}, {"draw": "argmax"}], ids=str)
@pytest.mark.parametrize("joint", [False, True])
def test_weights_that_break_before_views_are_predicted_go_back_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any], joint: bool
) -> None:
    """In step 5, before the round at half of the budget, which would draw views by what is not finite."""
    monkeypatch.setattr(trainer, "EVERY", 100)
    breaking(monkeypatch, 5)
    recipe = toy(steps=12, checkpoint_every=4, starts=(0.25, 0.5), **settings)
    run = train(jointly(recipe) if joint else recipe, tmp_path, quiet=True)
    (rolled,) = [line for line in stats(tmp_path) if line.get("event") == "rollback"]
    assert (run.step, rolled["at"], rolled["step"]) == (12, 6, 4)
    assert rolled["reason"] == "training broke down by step 6: predicted views are not finite; lower the learning rate"


def test_the_second_time_it_stops_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    breaking(monkeypatch, 6, 9)
    with pytest.raises(Diverged, match="broke down .* lower the learning rate"):
        train(toy(steps=12, checkpoint_every=4, views="known"), tmp_path, quiet=True)
    good = checkpoint.load(checkpoint.newest(tmp_path / "checkpoints"))
    assert all(v.isfinite().all() for v in good.values() if v.is_floating_point())


def test_without_a_checkpoint_it_stops_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    breaking(monkeypatch, 2)
    with pytest.raises(Diverged):
        train(toy(steps=12, views="known"), tmp_path, quiet=True)


@pytest.mark.parametrize("every, last", [(5, 20), (100, 7)])
def test_what_is_not_finite_is_never_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, every: int, last: int
) -> None:
    """Losses are read now and then only: a checkpoint, or the end of the run, may come before they are."""
    monkeypatch.setattr(trainer, "EVERY", 100)
    breaking(monkeypatch, 7)
    try:
        train(toy(steps=last, checkpoint_every=every, views="known"), tmp_path, quiet=True)
    except Diverged:
        assert every == 100 and checkpoint.list_checkpoints(tmp_path / "checkpoints") == []
    else:
        assert events(tmp_path) == ["rollback"] and final(tmp_path)["generator/bias"].isfinite()


def test_a_run_that_was_rolled_back_and_stopped_keeps_its_log(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lines of before the rollback have later steps than the checkpoint of after it: steps do not say which to keep."""
    recipe = toy(steps=12, checkpoint_every=4, views="known")
    breaking(monkeypatch, 8)
    whole = train(recipe, tmp_path / "whole", quiet=True).path
    steps = [(line["step"], line.get("event")) for line in stats(whole)]
    assert steps[:5] == [(2, None), (4, None), (6, None), (8, None), (4, "rollback")]

    breaking(monkeypatch, 8)
    update, calls = Trainer._update_generator, iter(range(1, 100))  # pyright: ignore[reportPrivateUsage]

    def stopped(self: Trainer, *arguments: Any) -> Tensor:
        if next(calls) == 9:
            signal.raise_signal(signal.SIGINT)
        return update(self, *arguments)

    monkeypatch.setattr(Trainer, "_update_generator", stopped)
    assert train(recipe, tmp_path / "stopped", quiet=True).step == 5
    resume(tmp_path / "stopped", recipe, quiet=True)
    assert differences(whole, tmp_path / "stopped") == []


class Constant(LowRankGenerator):
    """A generator that always makes the same shape."""

    def forward(self, code: Tensor) -> Tensor:
        return super().forward(torch.zeros_like(code).detach()) * 0 + self.bias * 0 + 0.3


def test_collapse_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(health, "WARM_UP", 4)
    recipe = toy(steps=40, checkpoint_every=2, views="direct").replace(generator=lambda: Constant(16, 8, 8, 4))
    with pytest.raises(Diverged, match="collapsed at step .* looks the same .*lower the learning rate"):
        train(recipe, tmp_path, quiet=True)
    assert events(tmp_path) == ["rollback"]


class Flat(Silhouette):
    """A projection in which all samples look the same."""

    def forward(self, x: Tensor, *, azimuth: Tensor, elevation: Tensor) -> Tensor:
        return super().forward(x, azimuth=azimuth, elevation=elevation) * 0 + 0.5


def test_samples_that_differ_in_any_panel_have_not_collapsed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(health, "WARM_UP", 4)
    recipe = toy(steps=16, views="known")  # six checks after the first four steps
    flat = Panel(azimuth_bins(4, Flat(size=16)), recipe.panels[0].data)
    train(recipe.replace(panels=[flat, *recipe.panels]), tmp_path, quiet=True)
    assert events(tmp_path) == []


def test_a_collapse_is_five_checks_in_a_row() -> None:
    dull = 0
    for _ in range(4):
        dull = check(400, {"loss": 1.0}, 0.01, dull)
    assert dull == 4 and check(400, {"loss": 1.0}, 0.5, dull) == 0
    with pytest.raises(Diverged):
        check(400, {"loss": 1.0}, 0.01, dull)
    assert check(300, {"loss": 1.0}, 0.0, 4) == 0


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_losses_that_are_not_finite_are_named(value: float) -> None:
    with pytest.raises(Diverged, match="step 7: loss_d is"):
        check(7, {"loss_g": 0.0, "loss_d": value}, 1.0, 0)


def test_weights_that_are_not_finite_are_named() -> None:
    good = {"a": torch.ones(2), "n": torch.tensor(3)}
    check_finite(7, good, bool)
    with pytest.raises(Diverged, match="step 7: b is not finite"):
        check_finite(7, {**good, "b": torch.tensor([1.0, float("nan")])}, bool)
    with pytest.raises(Diverged, match="a weight"):
        check_finite(7, good, lambda mine: True)  # another process saw it


def test_weights_whose_samples_are_not_finite_are_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(LowRankGenerator, "sample", lambda *_, **__: torch.full((1, 16, 16, 16), float("nan")))
    with pytest.raises(Diverged, match="by step 4: a sample is not finite"):
        train(toy(steps=12, checkpoint_every=4, views="known"), tmp_path, quiet=True)
    assert checkpoint.list_checkpoints(tmp_path / "checkpoints") == []


def test_diversity_is_a_share_of_the_real_images() -> None:
    real = torch.rand(64, 1, 4, 4, generator=torch.Generator().manual_seed(0))
    assert diversity(real, real / 2) == pytest.approx(0.5, rel=1e-4)
    assert diversity(real, torch.ones_like(real)) == 0


def test_the_command_line_says_it_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    breaking(monkeypatch, 2)
    recipe = f"{Path(__file__).with_name('toy.py')}:toy"
    assert main(["train", recipe, "--steps", "4", "--views", "known", "--quiet", "--out", str(tmp_path / "run")]) == 2
    err = capsys.readouterr().err
    assert err.startswith("unproject: training broke down") and err.count("\n") == 1
