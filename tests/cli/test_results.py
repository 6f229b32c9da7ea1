"""`unproject sample`, `evaluate`, `export` and `demo` on runs."""

from __future__ import annotations

import json
import re
import shlex
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from unproject._objects import find_object
from unproject.cli import main
from unproject.cli.evaluate import table
from unproject.data import chairs
from unproject.export import turntable
from unproject.metrics import Score
from unproject.training import Recipe, load
from unproject.training.origin import rebuild
from unproject.training.trainer import Trainer

TOY = f"{Path(__file__).parents[1] / 'training' / 'toy.py'}:toy"


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """A short run for each assignment of views."""
    made: dict[str, Path] = {}

    def run(views: str) -> Path:
        if views not in made:
            made[views] = tmp_path_factory.mktemp("runs") / views
            flags = ["--views", views, "--steps", "3", "--quiet", "--out", str(made[views])]
            assert main(["train", TOY, *flags]) == 0
        return made[views]

    return run


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Run a command that must be refused in one line; the line."""

    def call(*argv: str | Path) -> str:
        capsys.readouterr()
        assert main([str(word) for word in argv]) == 2
        err = capsys.readouterr().err
        assert err.startswith("unproject: ") and err.endswith("\n") and err.count("\n") == 1, err
        return err.removeprefix("unproject: ").strip()

    return call


def sample(run: Path, out: Path, *flags: str) -> np.ndarray:
    assert main(["sample", str(run), "--out", str(out), *flags]) == 0
    with np.load(out) as arrays:
        assert arrays.files == ["volume"]
        return arrays["volume"]


def test_samples_are_what_the_design_says(runs: Callable[[str], Path], tmp_path: Path) -> None:
    volumes = sample(runs("known"), tmp_path / "x.npz", "--n", "5", "--seed", "2")
    assert volumes.shape == (5, 16, 16, 16) and volumes.dtype == np.float32
    assert volumes.min() >= 0 and volumes.max() <= 1
    drawn = load(runs("known")).generator.sample(5, seed=2)
    assert np.array_equal(volumes, drawn.numpy())


def test_the_seed_says_which_and_n_how_many(runs: Callable[[str], Path], tmp_path: Path) -> None:
    run = runs("known")
    a = sample(run, tmp_path / "a.npz", "--n", "3", "--seed", "1")
    b = sample(run, tmp_path / "b.npz", "--n", "7", "--seed", "1")
    c = sample(run, tmp_path / "c.npz", "--n", "3", "--seed", "2")
    assert np.array_equal(a, b[:3]) and not np.array_equal(a, c)


def test_samples_of_twice_the_size(runs: Callable[[str], Path], refused: Callable[..., str], tmp_path: Path) -> None:
    run = runs("known")
    fine = sample(run, tmp_path / "fine.npz", "--n", "3", "--seed", "2", "--size", "32")
    coarse = sample(run, tmp_path / "coarse.npz", "--n", "3", "--seed", "2")
    assert fine.shape == (3, 32, 32, 32) and fine.dtype == np.float32
    assert np.abs(fine.reshape(3, 16, 2, 16, 2, 16, 2).mean((2, 4, 6)) - coarse).max() < 0.05
    words = ["export", str(run), "--n", "3", "--seed", "2", "--size", "32", "--no-largest-part", "--to", "npz"]
    assert main([*words, "--out", str(tmp_path / "out.npz")]) == 0
    with np.load(tmp_path / "out.npz") as arrays:
        assert np.array_equal(arrays["volume"], fine)
    assert "size 24: choose 16" in refused("sample", run, "--size", "24", "--out", tmp_path / "no.npz")
    said = refused("export", tmp_path / "fine.npz", "--size", "64", "--out", tmp_path / "no.glb")
    assert "give the run in its place" in said and not list(tmp_path.glob("no*"))


def test_samples_that_do_not_fit_into_memory(
    runs: Callable[[str], Path], refused: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """3 samples of 64³, twice, are 6 MB; what is made at once is at most 64 MB eight times."""
    words = ("sample", runs("known"), "--n", "3", "--size", "64", "--out")
    monkeypatch.setattr("unproject.training.memory.available_memory", lambda _: 500_000_000)
    assert "lower n or size" in refused(*words, tmp_path / "x.npz")
    monkeypatch.setattr("unproject.training.memory.available_memory", lambda _: 600_000_000)
    assert main([str(word) for word in (*words, tmp_path / "x.npz")]) == 0


def test_a_run_of_the_package_needs_no_trust(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 4)
    run = tmp_path / "run"
    small = ["--size", "16", "--bins", "2", "--views-per-shape", "2", "--channels", "8", "--rank", "2", "--batch", "4"]
    flags = ["--views", "known", "--steps", "1", "--quiet"]
    assert main(["train", "shapes", *small, *flags, "--out", str(run)]) == 0
    assert main(["resume", str(run), "--steps", "2", "--quiet"]) == 0
    assert sample(run, tmp_path / "x.npz", "--n", "1").shape == (1, 16, 16, 16)


@pytest.mark.parametrize(
    "flags, said",
    [
        (["--n", "0"], "--n 0"),
        (["--n", "-1"], "--n -1"),
        (["--n", "x"], "n"),
        (["--out", "x.txt"], ".npz"),
        (["--out", "x"], ".npz"),
    ],
)
def test_samples_that_make_no_sense(
    runs: Callable[[str], Path], refused: Callable[..., str], tmp_path: Path, flags: list[str], said: str
) -> None:
    assert said in refused("sample", runs("known"), "--out", tmp_path / "y.npz", *flags)
    assert list(tmp_path.iterdir()) == []


def test_samples_that_cannot_be_written(
    runs: Callable[[str], Path], refused: Callable[..., str], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("precious")
    assert str(tmp_path / "file") in refused("sample", runs("known"), "--out", tmp_path / "file" / "x.npz")
    (tmp_path / "x.npz").mkdir()
    assert str(tmp_path / "x.npz") in refused("sample", runs("known"), "--out", tmp_path / "x.npz")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "x.npz"]


def evaluate(capsys: pytest.CaptureFixture[str], run: Path, *flags: str | Path) -> dict[str, dict[str, Any]]:
    capsys.readouterr()
    assert main(["evaluate", str(run), "--json", "--trust", "--n", "12", *map(str, flags)]) == 0
    found = capsys.readouterr()
    assert found.err == ""
    return json.loads(found.out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


@pytest.fixture(scope="module")
def shapes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("reference") / "shapes.npz"
    np.savez(path, volume=chairs(10, 16, seed=5).numpy())
    return path


@pytest.mark.parametrize("views", ["predicted", "known", "single", "direct"])
def test_scores_are_one_json_object(
    runs: Callable[[str], Path], capsys: pytest.CaptureFixture[str], shapes: Path, views: str
) -> None:
    scores = evaluate(capsys, runs(views), "--reference", shapes)
    assert scores and all(set(score) == {"value", "protocol", "n", "seed"} for score in scores.values())
    assert all(isinstance(s["value"], float) and np.isfinite(s["value"]) for s in scores.values())
    assert all(s["protocol"] and s["n"] >= 0 and s["seed"] == 0 for s in scores.values())
    assert any("mmd" in name.lower() for name in scores) and any("cov" in name.lower() for name in scores)
    assert any("view" in name.lower() for name in scores) == (views == "predicted")


def test_scores_repeat_and_depend_on_the_seed(
    runs: Callable[[str], Path], capsys: pytest.CaptureFixture[str], shapes: Path
) -> None:
    a, b, c = (evaluate(capsys, runs("known"), "--reference", shapes, "--seed", s) for s in ("0", "0", "1"))
    assert a == b and a != c


def test_the_recipe_is_made_once(
    runs: Callable[[str], Path], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[Recipe] = []
    monkeypatch.setattr("unproject.training.run.rebuild", lambda *args: made.append(rebuild(*args)) or made[-1])
    assert "verdict" in evaluate(capsys, runs("known")) and len(made) == 1


def test_scores_against_silhouettes(
    runs: Callable[[str], Path], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    np.savez(tmp_path / "masks.npz", image=(chairs(10, 16, seed=5).amax(3).transpose(1, 2).flip(1)[:, None]).numpy())
    scores = evaluate(capsys, runs("known"), "--reference", tmp_path / "masks.npz")
    of_them = {name: score for name, score in scores.items() if "silhouette" in name}
    assert of_them and all("silhouettes" in score["protocol"] for score in of_them.values())


def test_scores_can_be_read_by_people_too(
    runs: Callable[[str], Path], capsys: pytest.CaptureFixture[str], shapes: Path
) -> None:
    capsys.readouterr()
    assert main(["evaluate", str(runs("known")), "--trust", "--n", "8", "--reference", str(shapes)]) == 0
    scores, _, notes = capsys.readouterr().out.partition("\nverdict: ")[0].partition("\n\n")
    lines = [line for line in scores.splitlines() if "next:" not in line]
    assert len(lines) >= 8 and all(abs(float(line.split()[1])) < 1e6 for line in lines)
    assert max(map(len, lines)) < 190 and any("8 generated vs" in line for line in lines)
    for note in notes.strip().splitlines():
        mark, _, text = note.partition(" ")
        assert scores.count(mark) > 1 and text not in scores


def test_one_picture_is_no_set_to_compare_with(
    runs: Callable[[str], Path], refused: Callable[..., str], tmp_path: Path
) -> None:
    np.savez(tmp_path / "one.npz", image=chairs(1, 16, seed=5).amax(3)[:, None].numpy())
    said = refused("evaluate", runs("known"), "--trust", "--n", "4", "--reference", tmp_path / "one.npz")
    assert "one.npz: holds one picture that can be used; give two at least" in said


def test_scores_of_equal_numbers_are_told_where_they_differ() -> None:
    scores = {name: Score(value, "as given", 2) for name, value in {"a": 1, "a_equal": 1, "b": 1, "b_equal": 2}.items()}
    told = [line.split()[0] for line in table(scores).splitlines() if line]
    assert told == ["a", "b", "b_equal"]


@pytest.mark.parametrize(
    "flags",
    [
        ["--n", "0"],
        ["--n", "-3"],
        ["--reference", "nowhere"],
        ["--threads", "0"],
        ["--reference", "empty"],
        ["--n", "x"],
    ],
)
def test_evaluations_that_make_no_sense(
    runs: Callable[[str], Path],
    refused: Callable[..., str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    flags: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("empty").mkdir()
    assert refused("evaluate", runs("known"), "--trust", "--json", *flags)


def test_direct_training_is_not_scored_by_silhouettes(
    runs: Callable[[str], Path], refused: Callable[..., str], tmp_path: Path
) -> None:
    np.savez(tmp_path / "masks.npz", image=np.random.default_rng(0).random((6, 1, 16, 16)).astype(np.float32))
    assert refused("evaluate", runs("direct"), "--trust", "--n", "6", "--reference", tmp_path / "masks.npz")


def test_a_run_is_exported(runs: Callable[[str], Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Untrained shapes are nearly empty, so the threshold may leave none: a run's weights are made to show some."""
    volume = sample(runs("known"), tmp_path / "x.npz", "--n", "2")
    ball = np.zeros_like(volume)
    ball[:, 4:12, 3:13, 4:12] = 1
    np.savez(tmp_path / "x.npz", volume=ball)
    assert main(["export", str(tmp_path / "x.npz"), "--to", "glb", "--n", "2", "--out", str(tmp_path / "glb")]) == 0
    meshes = [trimesh.load(path, force="mesh") for path in sorted((tmp_path / "glb").glob("*.glb"))]
    assert len(meshes) == 2 and all(mesh.is_watertight for mesh in meshes)
    assert main(["export", str(runs("known")), "--to", "png", "--n", "2", "--out", str(tmp_path / "a.png")]) == 0
    with Image.open(tmp_path / "a.png") as picture:
        assert min(picture.size) > 16
    assert main(["export", str(runs("known")), "--to", "npz", "--n", "2", "--out", str(tmp_path / "b.npz")]) == 0
    with np.load(tmp_path / "b.npz") as arrays:
        assert np.array_equal(arrays["volume"], volume)


def test_a_run_of_empty_shapes_says_so(
    runs: Callable[[str], Path], refused: Callable[..., str], tmp_path: Path
) -> None:
    volume = torch.from_numpy(sample(runs("known"), tmp_path / "x.npz", "--n", "2"))
    if (volume > 0.5).any():
        pytest.skip("the toy has learned something")
    refused("export", runs("known"), "--to", "glb", "--n", "2", "--out", tmp_path / "glb")
    assert not (tmp_path / "glb").exists()


@pytest.fixture
def small_demo(monkeypatch: pytest.MonkeyPatch) -> None:
    """The demo with the toy in place of the recipe, and boxes in place of what it makes of chairs in three steps.

    Each step takes a second by its clock: by that of a machine a first step may take longer than all minutes given.
    """
    toy = find_object(TOY)

    def recipe(minutes: float, seed: int) -> Any:
        return toy(minutes=minutes, seed=seed)

    def boxes(self: Any, n: int, seed: int = 0, batch: int = 64) -> torch.Tensor:
        volume = torch.zeros(n, 16, 16, 16)
        volume[:, 4:12, 3:13, 4:12] = 1
        return volume

    monkeypatch.setattr(Trainer, "seconds", property(lambda trainer: float(trainer.state.counters.step)))
    monkeypatch.setattr("unproject.recipes.shapes.shapes", recipe)
    monkeypatch.setattr("unproject.export.turntable", partial(turntable, frames=3))
    monkeypatch.setattr("unproject.networks.Generator.sample", boxes)


def test_the_demo_leaves_pictures_and_meshes(
    small_demo: None, tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Callable[..., str]
) -> None:
    """And what its help and its last lines name."""
    assert main(["demo", "--help"]) == 0
    named = set(re.findall(r"[\w/]+\.(?:png|gif|glb)|\brun(?=/)", capsys.readouterr().out))
    out = tmp_path / "demo"
    assert main(["demo", "--minutes", "0.01", "--out", str(out)]) == 0
    names = {path.name for path in out.iterdir()}
    assert {"silhouettes.png", "chairs.png", "turntable.gif", "run"} <= names
    assert len(list(out.rglob("*.glb"))) == 16
    printed = capsys.readouterr().out
    assert "turntable.gif" in printed
    assert "verdict: " in printed
    assert (out / "run" / "verdict.json").is_file()
    assert "holds a demo already" in refused("demo", "--out", out)
    said = set(re.findall(r"[\w/]+\.(?:png|gif|glb)", printed.partition("demo: ")[2]))
    assert len(named) == 5 and all((out / name.replace("NN", "00")).exists() for name in named | said)
    assert names == {name.split("/")[0] for name in named}


def test_a_demo_whose_shapes_are_all_empty_says_so_and_leaves_its_run(
    small_demo: None, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """After a few seconds of training, on a slow machine."""
    monkeypatch.setattr("unproject.networks.Generator.sample", lambda self, n, seed=0: torch.zeros(n, 16, 16, 16))
    assert main(["demo", "--minutes", "0.01", "--out", str(tmp_path / "demo")]) == 0
    assert {path.name for path in (tmp_path / "demo").iterdir()} == {"silhouettes.png", "chairs.png", "run"}
    assert "warning: all 16 samples are empty" in capsys.readouterr().err


def test_a_demo_that_is_stopped_is_no_result_and_can_be_finished(
    small_demo: None, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    step, out = Trainer.step, tmp_path / "a demo"

    def interrupted(self: Trainer) -> None:
        step(self)
        signal.raise_signal(signal.SIGINT)

    with monkeypatch.context() as patch:
        patch.setattr(Trainer, "step", interrupted)
        assert main(["demo", "--minutes", "0.05", "--out", str(out)]) == 0
    assert {path.name for path in out.iterdir()} == {"silhouettes.png", "run"}
    said = capsys.readouterr().out.splitlines()[-1]
    found = re.fullmatch(r".*: stopped; unproject (resume .*) goes on, then unproject (export .*)", said)
    assert found is not None
    for command in found.groups():
        assert main([*shlex.split(command), "--trust"]) == 0  # of the toy, which is not the package's
    assert load(out / "run", trust=True).complete and len(list((out / "glb").glob("*.glb"))) == 16


@pytest.mark.parametrize("flags", [["--minutes", "nan"], ["--minutes", "0"], ["--threads", "0"]])
def test_demos_that_make_no_sense(
    small_demo: None, refused: Callable[..., str], tmp_path: Path, flags: list[str]
) -> None:
    assert refused("demo", "--out", tmp_path / "demo", *flags)
    assert not (tmp_path / "demo").exists()


def test_a_demo_that_cannot_be_written(small_demo: None, refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "demo").write_text("precious")
    assert str(tmp_path / "demo") in refused("demo", "--out", tmp_path / "demo")
    assert (tmp_path / "demo").read_text() == "precious"
