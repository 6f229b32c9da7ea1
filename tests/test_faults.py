"""Faults of the world around a run: full disks, damaged and foreign files, files that would like to be executed.

Each is one line on stderr that begins with `unproject: `, exit status 2, and nothing lost or half-written.
"""

from __future__ import annotations

import json
import os
import pickle
import resource
import shutil
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from unproject.cli import main
from unproject.training import Recipe, checkpoint, load
from unproject.training.description import describe

TOY = Path(__file__).parent / "training" / "toy.py"
TRAIN = ["train", f"{TOY}:toy", "--views", "known", "--steps", "4", "--checkpoint-every", "2", "--quiet"]


@pytest.fixture(scope="module", autouse=True)
def small_pictures() -> Iterator[None]:
    """Samples of networks that learned nothing are noise, whose surfaces take long to draw."""
    with pytest.MonkeyPatch.context() as patch:
        for many in ("domains.Volumes.previewed", "report.pictures.SHAPES"):
            patch.setattr(f"unproject.{many}", 1)
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished run with two checkpoints."""
    out = tmp_path_factory.mktemp("finished") / "run"
    assert main([*TRAIN, "--out", str(out)]) == 0
    return out


@pytest.fixture
def run(finished: Path, tmp_path: Path) -> Path:
    """A copy of it, to be damaged."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


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


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def temporaries(folder: Path) -> list[Path]:
    return list(folder.rglob(".*"))


def resume(run: Path, *flags: str) -> int:
    return main(["resume", str(run), "--trust", "--quiet", *flags])


# A disk that fills up


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of eight megabytes; a checkpoint of the toy takes 3.4."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(disk)]
    try:
        mounted = subprocess.run(mount, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        mounted = False
    if not mounted:
        pytest.skip("only root can mount a small disk")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_loses_nothing(small_disk: Path, refused: Callable[..., str]) -> None:
    run = small_disk / "run"
    assert main([*TRAIN, "--steps", "2", "--out", str(run)]) == 0
    before, filler = files(run), small_disk / "filler"
    free = shutil.disk_usage(small_disk).free
    filler.write_bytes(b"x" * max(free - 100_000, 0))
    line = refused("resume", run, "--trust", "--quiet", "--steps", "4")
    assert "No space left on device" in line and "free some space" in line and "step-000000004" in line
    assert temporaries(run) == []
    grown = ("stats.jsonl", "recipe.json")  # the log, and the new budget
    assert {k: v for k, v in files(run).items() if k in before and k not in grown} == {
        k: v for k, v in before.items() if k not in grown
    }
    assert load(run, trust=True).step == 2
    filler.unlink()
    assert resume(run) == 0 and load(run, trust=True).step == 4


@pytest.mark.parametrize("left", [0, 2000])
def test_a_full_disk_at_the_start(small_disk: Path, refused: Callable[..., str], left: int) -> None:
    (small_disk / "filler").write_bytes(b"x" * (shutil.disk_usage(small_disk).free - left))
    line = refused(*TRAIN, "--out", small_disk / "run")
    assert "No space left on device" in line and "run" in line
    assert [path for path in temporaries(small_disk)] == []


def test_a_file_too_large_for_the_file_system(run: Path, refused: Callable[..., str]) -> None:
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    previous = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, limits[1]))
    try:
        line = refused("resume", run, "--trust", "--quiet", "--steps", "6")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, previous)
    assert "File too large" in line and "step-000000006" in line
    assert load(run, trust=True).step == 4 and temporaries(run) == []
    assert resume(run, "--steps", "6") == 0 and load(run, trust=True).step == 6


def test_a_disk_that_fills_at_the_last_moment(
    run: Path, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(source: Path, target: Path) -> None:
        if "checkpoints" in str(target):
            raise OSError(28, "No space left on device", str(target))
        os.rename(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", full)
        assert "No space left" in refused("resume", run, "--trust", "--quiet", "--steps", "6")
    assert load(run, trust=True).step == 4 and temporaries(run) == []
    assert resume(run, "--steps", "6") == 0


def test_a_log_that_cannot_grow_is_named(small_disk: Path, refused: Callable[..., str]) -> None:
    run = small_disk / "run"
    assert main([*TRAIN, "--steps", "2", "--out", str(run)]) == 0
    (small_disk / "filler").write_bytes(b"x" * shutil.disk_usage(small_disk).free)
    stats = run / "stats.jsonl"
    from unproject.training.recorder import Recorder

    with pytest.raises(OSError) as caught, Recorder(run, 10**6, quiet=True) as recorder:
        for step in range(10_000):
            recorder.write(step, 0.0, loss=1.0)
    assert caught.value.filename == str(stats)


# Damaged and foreign checkpoints


def newest(run: Path) -> Path:
    return checkpoint.newest(run / "checkpoints")


def damage(kind: str, path: Path) -> None:
    tensors, data = checkpoint.load(path), path.read_bytes()
    if kind == "cut":
        path.write_bytes(data[: len(data) // 2])
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "text":
        path.write_text("weights")
    elif kind == "header":
        path.write_bytes(b"\xff" * 64 + data[64:])
    elif kind == "foreign":
        save_file(tensors, path)
    elif kind == "pickle":
        path.write_bytes(pickle.dumps(Bomb()))
    elif kind == "torch":
        torch.save(tensors, path)
    elif kind == "folder":
        path.unlink()
        path.mkdir()


KINDS = ("cut", "empty", "text", "header", "foreign", "pickle", "torch", "folder")


class Bomb:
    """Unpickling it would leave a trace."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.putenv, ("UNPROJECT_EXPLODED", "1")


@pytest.mark.parametrize("kind", KINDS)
def test_a_checkpoint_that_is_none(run: Path, refused: Callable[..., str], kind: str, tmp_path: Path) -> None:
    path = newest(run)
    damage(kind, path)
    before = files(run)
    for verb in (("sample", run, "--out", tmp_path / "x.npz"), ("resume", run, "--quiet", "--steps", "6")):
        line = refused(*verb, "--trust")
        assert str(path) in line and ("damaged" in line or "not a checkpoint of unproject" in line)
    assert files(run) == before and not (tmp_path / "x.npz").exists()
    assert subprocess.run("echo $UNPROJECT_EXPLODED", shell=True, capture_output=True).stdout == b"\n"


def test_the_advice_for_a_damaged_checkpoint_works(run: Path) -> None:
    damage("cut", newest(run))
    newest(run).unlink()
    assert load(run, trust=True).step == 2
    assert resume(run) == 0 and load(run, trust=True).step == 4


@pytest.mark.parametrize(
    "change",
    [
        lambda t: {k: v for k, v in t.items() if not k.startswith("counters/")},
        lambda t: {k: v for k, v in t.items() if not k.startswith("panels/")},
        lambda t: {k: v for k, v in t.items() if not k.startswith("generator/")},
        lambda t: {**t, "generator/bias": torch.zeros(3)},
        lambda t: {**t, "panels/0/assignment/views": torch.zeros(3, dtype=torch.int64)},
    ],
)
def test_a_checkpoint_of_another_run(run: Path, refused: Callable[..., str], change: Callable[..., Any]) -> None:
    path = newest(run)
    save_file(change(checkpoint.load(path)), path, {"format": checkpoint.FORMAT})
    assert "checkpoint" in refused("resume", run, "--trust", "--quiet", "--steps", "6")


def test_weights_that_do_not_fit_the_recipe(run: Path, refused: Callable[..., str], tmp_path: Path) -> None:
    path = newest(run)
    save_file({**checkpoint.load(path), "average/bias": torch.zeros(3)}, path, {"format": checkpoint.FORMAT})
    assert "do not fit recipe.json" in refused("sample", run, "--out", tmp_path / "x.npz", "--trust")


def test_a_run_without_a_checkpoint(run: Path, refused: Callable[..., str], tmp_path: Path) -> None:
    shutil.rmtree(run / "checkpoints")
    assert "no checkpoint yet" in refused("sample", run, "--out", tmp_path / "x.npz", "--trust")
    assert resume(run) == 0 and load(run, trust=True).step == 4


# Damaged and hostile recipe.json

VERBS = ("sample", "resume", "evaluate", "export")


def words(verb: str, run: Path, tmp_path: Path) -> list[str | Path]:
    return [verb, run, *(["--out", tmp_path / "x.npz"] if verb in ("sample", "export") else [])]


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "null", "3", '{"recipe": "x"}', "\xff\xfe", '{"recipe": 1, "arguments": {}, "resolved": {}}']
    + ['{"recipe": "", "arguments": [], "resolved": {}}', '{"recipe": "", "arguments": {}, "resolved": "x"}'],
)
def test_a_damaged_recipe(run: Path, refused: Callable[..., str], tmp_path: Path, verb: str, text: str) -> None:
    (run / "recipe.json").write_text(text, encoding="latin-1")
    assert f"{run / 'recipe.json'}: damaged" in refused(*words(verb, run, tmp_path))


@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize("what", ["missing", "empty", "file"])
def test_not_a_run(refused: Callable[..., str], tmp_path: Path, verb: str, what: str) -> None:
    path = tmp_path / "thing"
    if what == "empty":
        path.mkdir()
    elif what == "file":
        path.write_text("x")
    assert "not a run directory" in refused(*words(verb, path, tmp_path))
    assert not (tmp_path / "x.npz").exists() and (what != "missing" or not path.exists())


def rewrite(run: Path, **changes: Any) -> None:
    content = json.loads((run / "recipe.json").read_text())
    (run / "recipe.json").write_text(json.dumps({**content, **changes}))


def generator(call: Any, positional: Any = (), **arguments: Any) -> dict[str, Any]:
    return {"generator": {"call": call, "positional": positional, "arguments": arguments}}


def domain(described: Any) -> dict[str, Any]:
    """A good generator, and a domain."""
    return {**generator("unproject.networks:LowRankGenerator", [], size=16), "domain": described}


HOSTILE = {
    "os:system": generator("os:system", ["touch exploded"]),
    "another module": generator("antigravity:fly"),
    "no module": generator("system", ["touch exploded"]),
    "nothing": generator("", []),
    "looks like ours": generator("unproject_evil:make"),
    "through ours": generator("unproject.training.environment:subprocess.getoutput", ["touch exploded"]),
    "through ours, builtin": generator("unproject.cli:__builtins__.exec", ["open('exploded', 'w')"]),
    "not a generator": generator("unproject.networks:Discriminator", [[1, 16, 16]]),
    "abstract": generator("unproject.networks:Generator", [4]),
    "absent": generator("unproject.networks:Nothing"),
    "no such module": generator("unproject.nothing:Nothing"),
    "wrong argument": generator("unproject.networks:LowRankGenerator", [], sizes=16),
    "wrong value": generator("unproject.networks:LowRankGenerator", [], size=15),
    "impossible value": generator("unproject.networks:LowRankGenerator", [], rank=-3),
    "wrong kind": generator("unproject.networks:LowRankGenerator", 3),
    "number": generator(3),
    "no generator": {},
    "not even that": {"generator": "unproject"},
    "os:system as a domain": domain({"type": "os:system", "command": "touch exploded"}),
    "a domain through ours": domain(
        {"type": "unproject.training.environment:subprocess.getoutput", "cmd": "touch exploded"}
    ),
    "not a domain": domain({"type": "unproject.networks:LowRankGenerator"}),
    "a domain of nothing": domain({"type": ""}),
    "no domain": domain(3),
    "a domain's wrong argument": domain({"type": "unproject.domains.maps:Maps", "colour": 3}),
}


@pytest.mark.parametrize("resolved", HOSTILE.values(), ids=HOSTILE.keys())
def test_nothing_named_in_a_recipe_is_executed(
    run: Path, refused: Callable[..., str], tmp_path: Path, resolved: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "cwd").mkdir()
    (tmp_path / "cwd" / "unproject_evil.py").write_text("open('exploded', 'w')")
    monkeypatch.chdir(tmp_path / "cwd")
    monkeypatch.syspath_prepend(str(tmp_path / "cwd"))
    rewrite(run, resolved=resolved)
    line = refused("sample", run, "--out", tmp_path / "x.npz")
    assert str(run) in line
    assert not Path("exploded").exists() and not (tmp_path / "x.npz").exists()


@pytest.mark.parametrize("verb", ["resume", "evaluate"])
@pytest.mark.parametrize("name", ["os:system", "./evil.py:make", "nothing", "shapes:x"])
def test_a_recipe_from_outside_needs_trust(
    run: Path, refused: Callable[..., str], monkeypatch: pytest.MonkeyPatch, verb: str, name: str
) -> None:
    monkeypatch.chdir(run)
    Path("evil.py").write_text("open('exploded', 'w')")
    for function in (name, f"{TOY}:toy", "unproject.training.environment:subprocess.getoutput"):
        rewrite(run, recipe=name, function=function, arguments={"cmd": "touch exploded"})
        assert "--trust" in refused(verb, run)
        assert not Path("exploded").exists()


def test_a_generator_from_outside_needs_trust(tmp_path: Path, refused: Callable[..., str]) -> None:
    run, samples = tmp_path / "run", tmp_path / "x.npz"
    assert main(["train", f"{TOY}:own", "--out", str(run), "--quiet"]) == 0
    assert "--trust (trust=True) if you wrote it" in refused("sample", run, "--out", samples)
    assert main(["sample", str(run), "--out", str(samples), "--n", "2", "--trust"]) == 0
    assert np.load(samples)["volume"].shape == (2, 16, 16, 16)


def test_a_generator_in_a_file_is_found_by_another_process_in_another_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(TOY.parent)
    run = tmp_path / "run"
    assert main(["train", "toy.py:own", "--out", str(run), "--quiet"]) == 0
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(__import__("sys").modules, "_unproject_toy")
    assert load(run, trust=True).generator.sample(1).shape == (1, 16, 16, 16)
    assert resume(run, "--steps", "3") == 0 and load(run, trust=True).step == 3


def test_an_argument_that_the_recipe_does_not_take(run: Path, refused: Callable[..., str]) -> None:
    rewrite(run, recipe="shapes", function="unproject.recipes.shapes:shapes", arguments={"steps": 4, "sizes": 3})
    assert "does not take sizes" in refused("resume", run)


def test_data_that_changed_are_named(tmp_path: Path, refused: Callable[..., str]) -> None:
    data, run = tmp_path / "masks.npz", tmp_path / "run"
    images = np.zeros((8, 1, 16, 16), np.float32)
    images[:, :, 4:12, 4:12] = 1
    np.savez(data, image=images, azimuth=np.zeros(8, np.float32))
    assert main([*TRAIN, "--data", str(data), "--out", str(run)]) == 0
    assert resume(run) == 0
    images[3, 0, 2] = 1
    np.savez(data, image=images, azimuth=np.zeros(8, np.float32))
    assert f"the data differ from those that the run was started with ({data}" in refused(
        "resume", run, "--trust", "--quiet"
    )
    data.unlink()
    assert str(data) in refused("resume", run, "--trust", "--quiet")
    assert load(run, trust=True).step == 4


def test_a_run_from_python_is_resumed_from_python(run: Path, refused: Callable[..., str]) -> None:
    rewrite(run, recipe="", function="", arguments={})
    for verb in ("resume", "evaluate"):
        assert "built in Python" in refused(verb, run)


def test_a_description_survives_json() -> None:
    from unproject._objects import find_object

    recipe: Recipe = find_object(f"{TOY}:toy")()
    described = describe(recipe)
    assert json.loads(json.dumps(described)) == described
