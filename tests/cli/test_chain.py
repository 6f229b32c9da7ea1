"""The whole chain: `train`, the very command that it prints, the picture that this promises, and `evaluate`."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from unproject import export
from unproject.cli import main
from unproject.cli.evaluate import FOOTNOTE_LENGTH
from unproject.data import chairs, digits
from unproject.domains import relit
from unproject.recipes import names
from unproject.training import load

TOY = f"{Path(__file__).parents[1] / 'training' / 'toy.py'}"
SMALL = ["--size", "16", "--channels", "16", "--batch", "4", "--steps", "2", "--quiet", "--threads", "1"]
NARROW = ["--discriminator-channels", "4"]
FEW_VIEWS = ["--bins", "4", "--views-per-shape", "2"]
FEW_MAPS = ["--maps", "4", "--renderings", "2", *NARROW]
FLAGS = {
    "shapes": [*FEW_VIEWS, "--rank", "2", "--rounds", "1"],
    "shapes-paper": [*FEW_VIEWS, *NARROW, "--predictor-steps", "1", "--predictor-images", "16"],
    "digits": [],
    "digits-paper": NARROW,
}


def shapes_sheet(x: Tensor) -> Image.Image:
    return export.contact_sheet(x)


def digits_sheet(x: Tensor) -> Image.Image:
    return export.silhouette_sheet(1 - x, scale=2)


def materials_sheet(x: Tensor) -> Image.Image:
    return export.material_sheet(x, relit(x), scale=4)


def sheet_of(recipe: str) -> Callable[[Tensor], Image.Image]:
    known = {"shapes": shapes_sheet, "digits": digits_sheet}
    return known.get(recipe.removesuffix("-paper"), materials_sheet)


@pytest.fixture(autouse=True)
def few_chairs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 4)
    monkeypatch.setattr("unproject.recipes.held_out.CHAIRS", 8)


ESTIMATED = {
    "test_the_printed_command_draws_what_was_learned",
    "test_a_step_that_needs_too_much_memory_is_refused",
    "test_data_that_need_too_much_memory_are_refused_before_they_are_made",
    "test_long_steps_are_announced",
    "test_parts_of_ones_own_that_do_not_fit_are_told_of",
}
SAME = {"metal-paper", "plastic", "plastic-paper", "fabric", "correlated"}
"""What differs from wood or metal in the procedural data alone."""


@pytest.fixture(autouse=True)
def few_estimates_here(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """An estimate takes longer than two steps."""
    recipe = request.getfixturevalue("recipe") if "recipe" in request.fixturenames else None
    if request.function.__name__ not in ESTIMATED or recipe in SAME:
        monkeypatch.setattr("unproject.cli.train._estimate", lambda recipe, device: None)


def trained(run: Path, recipe: str, *flags: str) -> None:
    assert main(["train", recipe, *flags, "--out", str(run)]) == 0


def pixels(picture: Image.Image) -> np.ndarray:
    return np.asarray(picture.convert("RGB"))


@pytest.mark.parametrize("recipe", [*names(), f"{TOY}:own"], ids=lambda name: Path(name).name)
def test_the_printed_command_draws_what_was_learned(
    recipe: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "a run"
    own, count = recipe.startswith(TOY), 16
    if own:  # samples are noise, whose surfaces take long to draw
        count = 2
        for many in ("cli.export.SAMPLES", "domains.Volumes.previewed", "report.pictures.SHAPES"):
            monkeypatch.setattr(f"unproject.{many}", count)
    trained(run, recipe, *(["--quiet"] if own else [*FLAGS.get(recipe, FEW_MAPS), *SMALL]))
    command = capsys.readouterr().out.strip().partition("next: unproject ")[2]
    assert main(shlex.split(command)) == 0
    draw = shapes_sheet if own else sheet_of(recipe)
    samples = load(run, trust=own).sample(count, largest_part=True)
    with Image.open(run / "samples.png") as picture:
        assert np.array_equal(pixels(picture), pixels(draw(samples)))
    capsys.readouterr()
    assert main(["evaluate", str(run), "--n", "16", "--threads", "1", "--json", *(["--trust"] if own else [])]) == 0
    scores = json.loads(capsys.readouterr().out)
    expected = {"shapes": "mmd_iou", "digits": "frechet"}.get(recipe.removesuffix("-paper"), "correlation_error")
    assert ("in_one_piece" if own else expected) in scores


# Data of one's own, without a reference


@pytest.fixture
def own_data(tmp_path: Path) -> Callable[[str], Path]:
    def write(recipe: str) -> Path:
        path = tmp_path / "own.npz"
        if recipe == "shapes":
            np.savez(path, silhouettes=chairs(12, 16).amax(3).transpose(1, 2).flip(1).numpy())
        elif recipe == "digits":
            np.savez(path, images=digits(16)[:12, 0].numpy())
        else:
            for name in ("diffuse", "flash"):
                (tmp_path / "own" / name).mkdir(parents=True)
                for k in range(8):
                    noise = Image.effect_noise((40, 36), 60 + k).convert("RGB")
                    noise.save(tmp_path / "own" / name / f"{k}.png")
            return tmp_path / "own"
        return path

    return write


CHECKS = {
    "shapes": {"diversity", "in_one_piece", "empty", "kernel_silhouette", "view_information", "views_used"},
    "digits": {"diversity", "kernel_line"},
    "wood": {"diversity", "patch_diffuse", "patch_flash"},
}


@pytest.mark.parametrize("recipe", CHECKS)
def test_a_run_without_a_reference_is_checked_by_itself(
    recipe: str, own_data: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    small = SMALL if recipe == "wood" else [*FLAGS[recipe], *SMALL]
    trained(run, recipe, "--data", str(own_data(recipe)), *small)
    capsys.readouterr()
    assert main(["evaluate", str(run), "--n", "12", "--json", "--threads", "1"]) == 0
    scores = json.loads(capsys.readouterr().out)
    assert CHECKS[recipe] <= set(scores)
    against_data = [name for name in scores if name.startswith(("kernel_", "patch_"))]
    assert all("training images" in scores[name]["protocol"] for name in against_data)

    assert main(["evaluate", str(run), "--n", "12", "--threads", "1"]) == 0
    table = capsys.readouterr().out
    assert "Self-checks only; --reference" in table
    for score in (score for name, score in scores.items() if f"{name} " in table):
        assert all(table.count(part) == 1 for part in score["protocol"].split(", ") if len(part) > FOOTNOTE_LENGTH)


def test_a_table_prints_each_long_part_of_protocols_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    trained(run, "digits", *SMALL)
    capsys.readouterr()
    assert main(["evaluate", str(run), "--n", "20", "--threads", "1"]) == 0
    table = capsys.readouterr().out
    scores, notes = table.split("\n\n")
    assert "[1]" in scores and notes.startswith("[1] ")
    assert all(table.count(note.partition(" ")[2]) == 1 for note in notes.splitlines())


# Large materials


def test_materials_are_sampled_and_exported_at_a_multiple_of_their_size(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    run, large = tmp_path / "run", tmp_path / "large.npz"
    trained(run, "wood", *FEW_MAPS, *SMALL)
    side = load(run).sample(1).shape[-1]
    assert main(["sample", str(run), "--n", "2", "--size", str(3 * side), "--out", str(large)]) == 0
    with np.load(large) as arrays:
        assert arrays["diffuse"].shape == (2, 3, 3 * side, 3 * side)
    for to in ("maps", "mtlx"):
        out = tmp_path / to
        assert main(["export", str(run), "--n", "1", "--size", str(3 * side), "--to", to, "--out", str(out)]) == 0
        (file,) = out.rglob("basecolor.png")
        with Image.open(file) as picture:
            assert picture.size == (3 * side, 3 * side)
    capsys.readouterr()
    assert main(["sample", str(run), "--size", str(side + 1), "--out", str(tmp_path / "no.npz")]) == 2
    assert "or a multiple of it" in capsys.readouterr().err
    monkeypatch.setattr("unproject.training.memory.available_memory", lambda _: 10**6)
    assert main(["sample", str(run), "--size", str(64 * side), "--out", str(tmp_path / "no.npz")]) == 2
    assert f"of size {64 * side} take about" in capsys.readouterr().err and not (tmp_path / "no.npz").exists()


# A short trial


def test_a_short_trial_has_few_rounds(tmp_path: Path) -> None:
    run = tmp_path / "run"
    trained(run, "shapes", *FEW_VIEWS, "--rank", "2", *SMALL, "--steps", "40")
    events = [line.get("event") for line in load(run).stats()]
    assert 1 <= events.count("assigned") <= 4


# Memory and time


def test_a_step_that_needs_too_much_memory_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("unproject.training.memory.available_memory", lambda device: 10**6)
    run = tmp_path / "run"
    assert main(["train", "digits", *SMALL, "--out", str(run)]) == 2
    error = capsys.readouterr().err
    assert re.match(
        r"unproject: a training step takes about \d+\.\d GB and 0\.0 GB are available; "
        r"lower --size or --batch or --channels, or add --force\n$",
        error,
    )
    assert not run.exists()
    trained(run, "digits", *SMALL, "--force")
    assert load(run).step == 2


def test_data_that_need_too_much_memory_are_refused_before_they_are_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 10**6)
    began = time.process_time()
    assert main(["train", "shapes", "--size", "256", "--out", str(tmp_path / "run")]) == 2
    assert "chairs of 256³ voxels takes about" in capsys.readouterr().err and time.process_time() - began < 20
    assert not (tmp_path / "run").exists()
    assert main(["train", "wood", "--size", "64", "--maps", "100000000", "--out", str(tmp_path / "run")]) == 2
    assert "lower --size or --maps, or give --data, or add --force" in capsys.readouterr().err


def test_long_steps_are_announced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("unproject.cli.train.SLOW_STEP", 0.0)
    trained(tmp_path / "run", "digits", *SMALL)
    first, *_, last = capsys.readouterr().out.splitlines()
    assert re.match(r"about \d+\.\d GB, about \d+ s a step$", first) and "next:" in last


ODD = """
import unproject as up
def recipe(*, seed: int = 0) -> up.Recipe:
    panel = up.Panel([up.Observation("itself", up.Identity())], up.Collection(up.data.chairs(4, 16)))
    return up.Recipe(up.networks.LowRankGenerator, [panel], discriminator=lambda shape: None, steps=1, seed=seed)
"""


def test_parts_of_ones_own_that_do_not_fit_are_told_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "odd.py").write_text(ODD)
    assert main(["train", f"{tmp_path}/odd.py:recipe", "--out", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("unproject: discriminator: called with (shape of one image, number of heads)")
    assert error.count("\n") == 1 and not (tmp_path / "run").exists()


SLEEPY = """
import time
from pathlib import Path
def recipe(*, seed: int = 0):
    Path(__file__).with_name("begun").touch()
    time.sleep(300)
"""


def test_a_signal_ends_the_preparation_of_data(tmp_path: Path, forked: None) -> None:
    (tmp_path / "sleepy.py").write_text(SLEEPY)
    words = [sys.executable, "-m", "unproject", "train", f"{tmp_path}/sleepy.py:recipe", "--out", f"{tmp_path}/run"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        deadline = time.monotonic() + 120
        while not (tmp_path / "begun").exists() and time.monotonic() < deadline:
            time.sleep(0.1)
        child.terminate()
        child.communicate(timeout=100)  # not the 300 seconds that it would sleep
    assert child.returncode != 0
    assert not (tmp_path / "run").exists()


# Empty samples


def silent(run: Path) -> None:
    """Make all samples of a run of shapes or images empty."""
    from safetensors.torch import load_file, save_file

    from unproject.training.checkpoint import FORMAT

    (newest,) = sorted((run / "checkpoints").glob("*.safetensors"))[-1:]
    tensors = load_file(newest)
    tensors["average/bias"] = torch.full_like(tensors["average/bias"], -50.0)
    save_file(tensors, newest, metadata={"format": FORMAT})


def test_empty_samples_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    trained(run, "shapes", *FLAGS["shapes"], *SMALL)
    silent(run)
    capsys.readouterr()
    words = ["export", str(run), "--to", "png", "--out", str(tmp_path / "x.png")]
    assert main(words) == 0
    assert capsys.readouterr().err.startswith("warning: all 16 samples are empty (nothing above 0.5)")
    assert main(["resume", str(run), "--steps", "3", "--quiet"]) == 0
    np.savez(tmp_path / "full.npz", volume=np.ones((2, 8, 8, 8), np.float32))
    capsys.readouterr()
    assert main(["export", str(tmp_path / "full.npz"), "--to", "png", "--out", str(tmp_path / "y.png")]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("value, warned", [(0.0, True), (1.0, False)])
def test_train_says_at_its_end_that_samples_are_empty(
    value: float,
    warned: bool,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("unproject.training.Run.sample", lambda self, n, seed=0: torch.full((n, 16, 16, 16), value))
    trained(tmp_path / "run", "shapes", *FLAGS["shapes"], *SMALL)
    assert capsys.readouterr().err.startswith("warning: all 6 samples are empty") == warned


@pytest.mark.parametrize("to", ["npz", "png"])
def test_some_empty_samples_are_counted(to: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    volume = np.ones((3, 8, 8, 8), np.float32)
    volume[1] = 0.4
    np.savez(tmp_path / "x.npz", volume=volume)
    assert main(["export", str(tmp_path / "x.npz"), "--to", to, "--out", str(tmp_path / f"y.{to}")]) == 0
    assert capsys.readouterr().err.startswith("warning: 1 of 3 samples empty (nothing above 0.5); another --seed")


def test_what_is_no_recipe_function_is_refused_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    """Naming the observation of a file in place of its recipe."""
    example = Path(__file__).parents[2] / "examples" / "depth.py"
    assert main(["train", f"{example}:depth"]) == 2
    assert "is no recipe but of type Observation: name a function" in capsys.readouterr().err


def test_a_budget_that_is_spent_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    trained(run, "digits", *SMALL)
    capsys.readouterr()
    assert main(["resume", str(run), "--quiet"]) == 0
    assert "its budget was spent already: give a larger --steps or --minutes" in capsys.readouterr().out


def test_a_ceiling_of_what_was_not_predicted_is_warned_of(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = str(tmp_path / "run")
    assert main(["train", f"{TOY}:toy", "--views", "known", "--steps", "1", "--quiet", "--out", run]) == 0
    capsys.readouterr()
    words = ["evaluate", run, "--trust", "--n", "4"]
    assert main([*words, "--ceiling"]) == 0 and "warning: --ceiling: needs predicted views" in capsys.readouterr().err
    assert main(words) == 0 and "ceiling" not in capsys.readouterr().err
