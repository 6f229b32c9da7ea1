"""Every recipe trains on a GPU as on the processor, and a run goes on there, and here, as if never interrupted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from comparing import differences
from test_pretended_device import ARMS, FLAGS, MAPS, SMALL

import unproject as up
from unproject.cli import main
from unproject.training.distribution import Distribution
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer
from unproject.training.verdict import judge

pytestmark = pytest.mark.gpu


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 12)
    monkeypatch.setattr("unproject.recipes.held_out.CHAIRS", 8)
    monkeypatch.setattr("unproject.training.trainer.EVERY", 1)


def trained(arm: str, place: Path, device: str, steps: int, recorder: Recorder, **flags: Any) -> Trainer:
    name, own = ARMS[arm]
    recipe = up.recipes.find(name)(**{**SMALL, **FLAGS.get(name, MAPS), **own, **flags})
    recipe = recipe.replace(batch=8, checkpoint_every=4, steps=steps)
    trainer = Trainer(recipe, place, recorder, distribution=Distribution(device))
    for _ in range(steps):
        trainer.step()
    return trainer


def losses(place: Path) -> list[dict[str, float]]:
    lines = [json.loads(line) for line in (place / "stats.jsonl").read_text().splitlines()]
    return [{k: v for k, v in line.items() if k in ("loss_d", "loss_g", "penalty")} for line in lines]


@pytest.mark.parametrize("arm", ARMS)
def test_losses_are_those_of_the_processor(arm: str, tmp_path: Path) -> None:
    for device in ("cpu", "cuda"):
        (tmp_path / device).mkdir()
        with Recorder(tmp_path / device, quiet=True) as recorder:
            trainer = trained(arm, tmp_path / device, device, 4, recorder)
    first, second = ([line for line in losses(tmp_path / device) if "loss_d" in line] for device in ("cpu", "cuda"))
    assert [line.keys() for line in first] == [line.keys() for line in second]
    for name, value in first[0].items():  # from then on rounding grows: Adam's first steps are signs of gradients
        assert second[0][name] == pytest.approx(value, rel=0.02, abs=0.02), name
    state = trainer.state
    assert state.sampler().sample(2, seed=0).device.type == "cpu"
    judge(state.sampler(), state.domain, [panel.assignment for panel in state.panels])


@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
@pytest.mark.parametrize("recipe", ["shapes", "shapes-paper", "digits", "wood"])
def test_a_run_on_a_gpu_repeats_and_goes_on_bit_for_bit(recipe: str, precision: str, tmp_path: Path) -> None:
    flags = ["--size", "16", "--channels", "16", "--batch", "8", "--quiet", "--device", "cuda"]
    flags += ["--precision", precision, "--checkpoint-every", "3"]
    words = {
        "shapes": ["--bins", "4", "--views-per-shape", "2", "--rounds", "2", "--rank", "2"],
        "shapes-paper": [
            "--bins",
            "4",
            "--views-per-shape",
            "2",
            "--discriminator-channels",
            "4",
            "--predictor-steps",
            "2",
            "--predictor-images",
            "16",
        ],
        "wood": ["--maps", "4", "--renderings", "2", "--discriminator-channels", "4"],
    }.get(recipe, [])
    train = ["train", recipe, *flags, *words]
    assert main([*train, "--steps", "6", "--out", str(tmp_path / "whole")]) == 0
    assert main([*train, "--steps", "6", "--out", str(tmp_path / "again")]) == 0
    assert differences(tmp_path / "whole", tmp_path / "again") == []
    newest = sorted((tmp_path / "again" / "checkpoints").iterdir())[-1]
    newest.unlink()
    assert main(["resume", str(tmp_path / "again"), "--quiet"]) == 0
    assert differences(tmp_path / "whole", tmp_path / "again") == []


def test_what_was_trained_on_a_gpu_goes_on_anywhere(tmp_path: Path) -> None:
    run, words = str(tmp_path / "run"), ["--quiet", "--size", "16", "--channels", "16", "--bins", "4"]
    assert main(["train", "shapes", *words, "--views-per-shape", "2", "--steps", "4", "--out", run]) == 0
    environment = json.loads((tmp_path / "run" / "environment.json").read_text())
    assert environment["cuda"] == torch.cuda.get_device_name()
    assert main(["resume", run, "--steps", "6", "--device", "cpu", "--quiet"]) == 0
    assert main(["resume", run, "--steps", "8", "--device", "cuda", "--quiet"]) == 0
    assert main(["sample", run, "--n", "2", "--out", str(tmp_path / "samples.npz")]) == 0
    assert main(["evaluate", run]) == 0


def test_compiled_and_plain_steps_are_alike(tmp_path: Path) -> None:
    for compiled in (False, True):
        place = tmp_path / str(compiled)
        place.mkdir()
        with Recorder(place, quiet=True) as recorder:
            trained("shapes", place, "cuda", 2, recorder, compile=compiled)
    for here, there in zip(losses(tmp_path / "False"), losses(tmp_path / "True"), strict=True):
        assert all(there[name] == pytest.approx(value, rel=0.02, abs=0.02) for name, value in here.items())
