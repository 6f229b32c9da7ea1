"""`unproject train` and `resume`: flags, defaults, and every bad input in one line with nothing half-written."""

from __future__ import annotations

import json
import os
import signal
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from unproject.cli import main
from unproject.training import load
from unproject.training.trainer import Trainer

TOY = f"{Path(__file__).parents[1] / 'training' / 'toy.py'}:toy"
QUICK = ["--views", "known", "--steps", "2", "--quiet"]


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


def masks(folder: Path, count: int = 8, size: int = 40, views: bool = True) -> Path:
    """A folder of pictures of boxes, with a views.csv."""
    folder.mkdir(parents=True)
    rows = ["file,azimuth"]
    for i in range(count):
        picture = np.zeros((size, size), np.uint8)
        picture[8:32, 10 : 20 + i] = 255
        Image.fromarray(picture).save(folder / f"{i}.png")
        rows.append(f"{i}.png,{i * 360 / count}")
    if views:
        (folder / "views.csv").write_text("\n".join(rows) + "\n")
    return folder


# What works


def test_a_folder_of_pictures_trains(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    assert main(["train", TOY, "--data", str(masks(tmp_path / "masks")), *QUICK, "--out", str(run)]) == 0
    out = capsys.readouterr().out
    assert out.startswith(f"{run}: 2 steps\n")
    next_command = out.strip().splitlines()[-1].removeprefix("next: unproject ").split()
    assert main([*next_command, "--trust", "--n", "2"]) == 0 and (run / "samples.png").stat().st_size > 0


def test_a_run_directory_holds_what_the_design_says(tmp_path: Path) -> None:
    run = tmp_path / "run"
    data = masks(tmp_path / "masks")
    assert main(["train", TOY, "--data", str(data), *QUICK, "--seed", "3", "--out", str(run)]) == 0
    assert {p.name for p in run.iterdir()} >= {"recipe.json", "environment.json", "checkpoints", "samples"}
    recipe = json.loads((run / "recipe.json").read_text())
    assert recipe["recipe"] == TOY and recipe["arguments"]["seed"] == 3
    assert recipe["arguments"]["data"] == {"path": str(data)}
    assert recipe["resolved"]["steps"] == 2 and len(recipe["resolved"]["panels"][0]["data"][0]["sha256"]) == 16
    environment = json.loads((run / "environment.json").read_text())
    assert {"command", "commit", "python", "packages", "cpus", "threads"} <= set(environment)
    for line in (run / "stats.jsonl").read_text().splitlines():
        assert {"step", "seconds"} <= set(json.loads(line))


def test_out_is_named_after_recipe_and_seed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["train", TOY, *QUICK, "--seed", "7"]) == 0
    assert load(Path("runs/toy-7")).step == 2


def test_progress_is_shown_unless_quiet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train", TOY, *QUICK[:-1], "--out", str(tmp_path / "a")]) == 0
    assert "training" in capsys.readouterr().err
    assert main(["train", TOY, *QUICK, "--out", str(tmp_path / "b")]) == 0
    assert "training" not in capsys.readouterr().err


def test_resume_goes_on_from_any_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    masks(tmp_path / "masks")
    monkeypatch.chdir(tmp_path)
    assert main(["train", TOY, "--data", "masks", *QUICK, "--out", "run"]) == 0
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert main(["resume", "../run", "--trust", "--quiet", "--steps", "3"]) == 0
    assert load(tmp_path / "run").step == 3


def test_a_new_budget_takes_the_place_of_the_old(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By a clock that goes on by a second a step."""
    monkeypatch.setattr(Trainer, "seconds", property(lambda trainer: float(trainer.state.counters.step)))
    run = tmp_path / "run"
    assert main(["train", TOY, *QUICK, "--out", str(run)]) == 0
    assert main(["resume", str(run), "--trust", "--quiet", "--minutes", "0.1"]) == 0
    assert load(run).step == 6
    assert main(["resume", str(run), "--trust", "--quiet", "--steps", "8"]) == 0
    assert load(run).step == 8


def test_a_budget_that_is_over_before_the_first_step_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Trainer, "seconds", property(lambda trainer: 10.0 + trainer.state.counters.step))
    run = tmp_path / "a run"
    assert main(["train", TOY, "--minutes", "0.1", "--out", str(run)]) == 0 and load(run).step == 0
    said = capsys.readouterr().out.strip().splitlines()[-1]
    assert said == (
        f"{run}: its budget was spent before the first step was done; unproject resume '{run}' --minutes 10 goes on"
    )


def test_ctrl_c_is_not_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    step, calls = Trainer.step, iter(range(1, 100))

    def interrupted(self: Trainer) -> object:
        if next(calls) == 2:
            signal.raise_signal(signal.SIGINT)
        return step(self)

    monkeypatch.setattr(Trainer, "step", interrupted)
    run = tmp_path / "run"
    assert main(["train", TOY, "--views", "known", "--steps", "4", "--quiet", "--out", str(run)]) == 0
    assert load(run).step == 2
    assert main(["resume", str(run), "--trust", "--quiet"]) == 0 and load(run).step == 4


# What does not


@pytest.mark.parametrize(
    "flags, said",
    [
        (["--steps", "0"], "steps"),
        (["--steps", "-5"], "steps"),
        (["--steps", "many"], "steps"),
        (["--steps", "1.5"], "steps"),
        (["--minutes", "nan"], "minutes"),
        (["--minutes", "inf"], "minutes"),
        (["--minutes", "0"], "minutes"),
        (["--minutes", "-1"], "minutes"),
        (["--batch", "0"], "batch"),
        (["--checkpoint-every", "0"], "checkpoint_every"),
        (["--views", "guessed"], "views"),
        (["--threads", "0"], "--threads 0"),
        (["--device", "abacus"], "device"),
        (["--stepz", "5"], "--steps"),
        (["--precision", "int4"], "precision"),
        (["--starts", "0.5", "0.2"], "starts"),
        (["--starts", "1.5"], "starts"),
    ],
)
@pytest.mark.parametrize("recipe", [TOY, "shapes"])
def test_a_flag_that_makes_no_sense(
    tmp_path: Path,
    refused: Callable[..., str],
    monkeypatch: pytest.MonkeyPatch,
    flags: list[str],
    said: str,
    recipe: str,
) -> None:
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 4)
    assert said in refused("train", recipe, *flags, "--out", tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize(
    "recipe, flags",
    [
        ("shapes", ["--size", "24"]),
        ("shapes", ["--size", "8"]),
        ("shapes", ["--size", "0"]),
        ("shapes", ["--size", "-16"]),
        ("shapes", ["--bins", "0"]),
        ("shapes", ["--bins", "1"]),
        ("shapes", ["--bands", "0"]),
        ("shapes", ["--views-per-shape", "0"]),
        ("shapes-paper", ["--steps", "0"]),
        ("shapes-paper", ["--size", "20"]),
        ("shapes-paper", ["--loss", "l2"]),
    ],
)
def test_a_size_that_makes_no_sense_leaves_nothing(
    tmp_path: Path, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch, recipe: str, flags: list[str]
) -> None:
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 4)
    size = [] if "--size" in flags else ["--size", "16"]
    assert refused("train", recipe, "--steps", "1", *size, *flags, "--out", tmp_path / "run")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("name", ["shape", "birds", "", "../x", "shapes-papr"])
def test_an_unknown_recipe(tmp_path: Path, refused: Callable[..., str], name: str) -> None:
    line = refused("train", name, "--out", tmp_path / "run")
    assert "there is no recipe" in line and "unproject recipes" in line
    assert not (tmp_path / "run").exists()


def test_the_nearest_recipe_is_named(refused: Callable[..., str]) -> None:
    assert "'shapes-paper'" in refused("train", "shapes-papr")


@pytest.mark.parametrize("name", ["nowhere.py:toy", "nowhere:toy", TOY + "s", TOY.replace(":toy", ":SIZE"), ":toy"])
def test_a_recipe_that_is_not_there(tmp_path: Path, refused: Callable[..., str], name: str) -> None:
    assert refused("train", name, "--out", tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_a_function_that_is_no_recipe(tmp_path: Path, refused: Callable[..., str]) -> None:
    (tmp_path / "mine.py").write_text("def make(*, steps: int = 1):\n    return steps\n")
    assert "make" in refused("train", f"{tmp_path / 'mine.py'}:make", "--out", tmp_path / "run")
    assert not (tmp_path / "run").exists()


def bomb(path: Path) -> None:
    """A PNG that says it is 40 000 pixels a side."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 40_000, 40_000, 1, 0, 0, 0, 0)
    rows = zlib.compress(b"\0" * 5001 * 100)
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b""))


def bad_data(kind: str, folder: Path) -> Path:
    path = folder / "data.npz"
    ones = np.ones((6, 1, 16, 16), np.float32)
    ones[:, :, :4] = 0
    if kind == "missing":
        return folder / "nowhere"
    if kind == "empty":
        (folder / "empty").mkdir()
        return folder / "empty"
    if kind in ("corrupt", "bomb", "text"):
        (folder / "pictures").mkdir()
        if kind == "bomb":
            bomb(folder / "pictures" / "a.png")
        else:
            (folder / "pictures" / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n" if kind == "corrupt" else b"hello")
        return folder / "pictures"
    arrays = {
        "nan": np.where(ones > 0, np.nan, ones),
        "infinite": np.where(ones > 0, np.inf, ones),
        "range": ones * 200,
        "dtype": ones.astype(np.complex64),
        "text array": np.array(["a", "b"]),
        "shape": ones[0, 0, 0],
        "none": ones[:0],
        "objects": np.array([{}], dtype=object),
    }
    if kind in arrays:
        np.savez(path, image=arrays[kind])
    elif kind == "cut":
        np.savez(path, image=ones)
        path.write_bytes(path.read_bytes()[:200])
    elif kind == "other keys":
        np.savez(path, a=ones, b=ones)
    return path


KINDS = (
    ["missing", "empty", "corrupt", "bomb", "text", "nan", "infinite", "range", "dtype", "text array", "shape"]
    + ["none", "objects", "cut", "other keys"]
)  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_data_that_cannot_be_used(tmp_path: Path, refused: Callable[..., str], kind: str) -> None:
    data = bad_data(kind, tmp_path)
    line = refused("train", "shapes", "--size", "16", "--steps", "1", "--data", data, "--out", tmp_path / "run")
    assert str(data) in line
    assert not (tmp_path / "run").exists()


def test_known_views_that_nobody_knows(tmp_path: Path, refused: Callable[..., str]) -> None:
    data = masks(tmp_path / "masks", views=False)
    line = refused("train", "shapes", "--size", "16", "--views", "known", "--data", data, "--out", tmp_path / "run")
    assert "views.csv" in line and "--views predicted" in line
    assert not (tmp_path / "run").exists()


def test_direct_training_on_pictures(tmp_path: Path, refused: Callable[..., str]) -> None:
    data = masks(tmp_path / "masks")
    line = refused("train", "shapes", "--size", "16", "--views", "direct", "--data", data, "--out", tmp_path / "run")
    assert "needs volumes" in line and not (tmp_path / "run").exists()


def test_pictures_that_are_not_square(tmp_path: Path, refused: Callable[..., str]) -> None:
    np.savez(tmp_path / "x.npz", image=np.ones((6, 1, 16, 24), np.float32))
    status = main(["train", "shapes", "--size", "16", "--steps", "1", "--quiet", "--rank", "2", "--channels", "8"]
                  + ["--data", str(tmp_path / "x.npz"), "--out", str(tmp_path / "run")])  # fmt: skip
    assert status in (0, 2)
    assert (tmp_path / "run").exists() == (status == 0)


@pytest.fixture
def as_nobody() -> Iterator[None]:
    """Without root's right to write anywhere."""
    if os.geteuid():
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


@pytest.mark.parametrize("place", ["file", "below a file", "locked", "endless"])
def test_a_place_that_cannot_be_written(
    tmp_path: Path, refused: Callable[..., str], request: pytest.FixtureRequest, place: str
) -> None:
    (tmp_path / "file").write_text("precious")
    (tmp_path / "locked").mkdir(mode=0o555)
    out = {
        "file": tmp_path / "file",
        "below a file": tmp_path / "file" / "run",
        "locked": tmp_path / "locked" / "run",
        "endless": tmp_path / ("x" * 300),
    }[place]
    if place == "locked":
        # pytest's own folders are for its user alone; how many there are depends on the workers.
        for folder in [tmp_path, *tmp_path.parents]:
            if folder == Path(tempfile.gettempdir()):
                break
            folder.chmod(0o755)
        request.getfixturevalue("as_nobody")
    line = refused("train", TOY, *QUICK, "--out", out)
    assert str(out)[:100] in line
    assert (tmp_path / "file").read_text() == "precious"


def test_a_run_is_not_overwritten(tmp_path: Path, refused: Callable[..., str]) -> None:
    run = tmp_path / "run"
    assert main(["train", TOY, *QUICK, "--out", str(run)]) == 0
    before = {p: p.read_bytes() for p in run.rglob("*") if p.is_file()}
    assert "holds a run already" in refused("train", TOY, *QUICK, "--seed", "1", "--out", run)
    assert {p: p.read_bytes() for p in run.rglob("*") if p.is_file()} == before


@pytest.mark.parametrize("flags", [["--steps", "0"], ["--minutes", "nan"], ["--steps", "-1"]])
def test_resuming_with_no_budget(tmp_path: Path, refused: Callable[..., str], flags: list[str]) -> None:
    run = tmp_path / "run"
    assert main(["train", TOY, *QUICK, "--out", str(run)]) == 0
    said = refused("resume", run, "--trust", "--quiet", *flags)
    assert ("give a finite number" if "nan" in flags else "must be positive") in said
    assert load(run).step == 2
