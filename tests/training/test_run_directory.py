"""What is written beside a run."""

from __future__ import annotations

import platform
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest
from PIL import Image
from toy import toy

from unproject._types import UserError
from unproject.adversarial.matching import Matching
from unproject.assignment import Panel
from unproject.cli import main
from unproject.data import Collection
from unproject.training import load, resume, train
from unproject.training.environment import _commit, environment
from unproject.training.run_directory import VERDICT, write_json
from unproject.training.trainer import Trainer


class Odd:
    """A penalty that holds what has no description."""

    every = 1

    def __init__(self) -> None:
        self.part = object()


def test_the_processor_is_named_if_the_machine_tells_it() -> None:
    table = Path("/proc/cpuinfo")
    found = environment()["processor"]
    if not table.exists() or "model name" not in table.read_text():
        pytest.skip("this machine does not tell")
    assert f": {found}\n" in table.read_text() and found != platform.machine()


def test_the_commit_is_that_of_the_package_not_of_a_repository_around_it(tmp_path: Path) -> None:
    if not shutil.which("git"):
        pytest.skip("there is no git")
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "x"], check=True)
    installed = tmp_path / ".venv" / "lib"
    installed.mkdir(parents=True)
    assert _commit(tmp_path) and _commit(installed) is None


def test_without_git_no_commit_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert _commit() is None


def test_a_recipe_that_lacks_a_part_is_another(tmp_path: Path) -> None:
    """Such as `matching`, which is described only if given."""
    matched = toy(views="known", steps=1).replace(matching=Matching(), balance_every=16)
    run = train(matched, tmp_path / "run", quiet=True).path
    with pytest.raises(UserError, match="matching differs from when the run was started"):
        resume(run, matched.replace(matching=None), steps=2, quiet=True)


def test_a_part_that_cannot_be_described_leaves_nothing_behind(tmp_path: Path) -> None:
    recipe = toy(views="known", steps=1).replace(penalty=Odd())
    with pytest.raises(UserError, match="cannot be written to recipe.json"):
        train(recipe, tmp_path / "run", quiet=True)
    assert not (tmp_path / "run").exists()


def test_a_run_that_goes_on_has_no_verdict_of_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """However it ends; one that has no newer checkpoint keeps it."""
    recipe = toy(views="known", steps=1, checkpoint_every=1)
    run = train(recipe, tmp_path / "run", quiet=True).path
    write_json(run / VERDICT, {"step": 1})
    step = Trainer.step

    def failing_at(last: int) -> None:
        monkeypatch.setattr(Trainer, "step", lambda self: step(self) if self.state.counters.step < last else 1 / 0)
        with pytest.raises(ZeroDivisionError):
            resume(run, recipe, steps=3, quiet=True)

    failing_at(1)
    assert (run / VERDICT).exists()
    failing_at(2)
    assert not (run / VERDICT).exists()


def test_a_new_run_leaves_checkpoints_of_another_alone(tmp_path: Path) -> None:
    """Of two the newest is kept, which would be the other's."""
    train(toy(steps=2, views="direct"), tmp_path, quiet=True)
    (tmp_path / "recipe.json").unlink()
    with pytest.raises(UserError, match="holds checkpoints of a run without its recipe.json; remove them"):
        train(toy(steps=1, views="direct"), tmp_path, quiet=True)


def test_a_run_within_its_own_data_does_not_learn_from_itself(tmp_path: Path) -> None:
    for k in range(8):
        picture = Image.new("L", (32, 32))
        picture.paste(255, (8, 6, 20 + k, 26))
        picture.save(tmp_path / f"{k}.png")
    learner = "--size 16 --channels 8 --rank 4 --batch 4 --no-augment --quiet"
    words = ["train", "shapes", *learner.split(), "--data", str(tmp_path), "--out", str(tmp_path / "runs" / "a")]
    assert main([*words, "--steps", "1"]) == 0
    (tmp_path / "runs" / "a" / "samples" / "x.png").write_bytes((tmp_path / "0.png").read_bytes())
    assert main(["resume", str(tmp_path / "runs" / "a"), "--steps", "2", "--quiet"]) == 0
    assert main(["evaluate", str(tmp_path / "runs" / "a"), "--n", "8"]) == 0


def test_other_data_than_those_of_training_are_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recipe = toy(steps=1, views="known")
    run = load(train(recipe, tmp_path, quiet=True).path, trust=True)

    def evaluate_with(panel: Panel) -> None:
        """Evaluate the run, whose recipe function reads these data by now."""
        monkeypatch.setattr("unproject.training.run.rebuild", lambda *of: recipe.replace(panels=[panel]))
        run.evaluate(n=8)

    panel = recipe.panels[0]
    first, *others = panel.collections
    other = replace(panel, data=(Collection(first.items.flip(3), latents=first.latents), *others))
    with pytest.warns(UserWarning, match="its data are others than in training"):
        evaluate_with(other)
    fewer = replace(panel, data=(first.subset(range(len(first) - 2)), *others))
    with pytest.raises(UserError, match=rf"trained on other data \({len(first)}, .* then, {len(first) - 2}, .* now\)"):
        evaluate_with(fewer)


def test_a_training_that_never_begins_leaves_the_place_free(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def too_much(self: object) -> None:
        raise MemoryError

    with monkeypatch.context() as patch:
        patch.setattr("unproject.training.trainer.Trainer.step", too_much)
        for place in (tmp_path / "new" / "run", tmp_path):
            with pytest.raises(MemoryError):
                train(toy(steps=2), place, quiet=True)
        assert not (tmp_path / "new" / "run").exists() and {path.name for path in tmp_path.iterdir()} == {"new"}
    run = train(toy(steps=2), tmp_path / "new" / "run", quiet=True)
    assert run.step == 2


def test_a_training_that_breaks_off_later_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    step = Trainer.step

    def once(self: Trainer) -> None:
        if self.state.counters.step == 1:
            raise MemoryError
        step(self)

    monkeypatch.setattr(Trainer, "step", once)
    with pytest.raises(MemoryError):
        train(toy(steps=2), tmp_path, quiet=True)
    assert (tmp_path / "recipe.json").exists()


def test_a_run_that_begins_with_weights_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    train(toy(steps=1), tmp_path / "first", quiet=True)

    def too_much(self: object) -> None:
        raise MemoryError

    monkeypatch.setattr("unproject.training.trainer.Trainer.step", too_much)
    with pytest.raises(MemoryError):
        train(toy(steps=2), tmp_path / "second", start=tmp_path / "first", quiet=True)
    assert (tmp_path / "second" / "recipe.json").exists()


@pytest.mark.parametrize(
    "name", ["samples/mine.png", "checkpoints/mine", "environment.json", "stats.jsonl", "report.html"]
)
def test_nothing_of_somebody_else_is_written_over(tmp_path: Path, name: str) -> None:
    mine = tmp_path / name
    mine.parent.mkdir(exist_ok=True)
    mine.write_text('{"mine": 1}')
    with pytest.raises(UserError, match=f"{name.split('/')[0]}: is there already, and a run would overwrite it"):
        train(toy(steps=1), tmp_path, quiet=True)
    assert mine.read_text() == '{"mine": 1}' and not (tmp_path / "recipe.json").exists()


def test_what_a_killed_start_leaves_is_no_hindrance(tmp_path: Path) -> None:
    for folder in ("checkpoints", "samples"):
        (tmp_path / folder).mkdir()
    write_json(tmp_path / "environment.json", environment())
    (tmp_path / "notes.txt").write_text("mine")
    assert train(toy(steps=1), tmp_path, quiet=True).step == 1 and (tmp_path / "notes.txt").exists()
