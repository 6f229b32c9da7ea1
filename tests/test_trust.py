"""What the campaign of `tools/fuzz.py` found, a test for each kind: damaged files of our own, odd flags, races.

Each is one line on stderr that begins with `unproject: `, exit status 2, and nothing left behind.
"""

from __future__ import annotations

import json
import math
import os
import shutil
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from unproject._files import read_json, understood
from unproject._types import UserError
from unproject.cli import main
from unproject.training import checkpoint, load

TOY = Path(__file__).parent / "training" / "toy.py"
TRAIN = ["train", f"{TOY}:toy", "--views", "known", "--steps", "2", "--quiet"]
Refused = Callable[..., str]


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("finished") / "run"
    assert main([*TRAIN, "--out", str(out)]) == 0
    return out


@pytest.fixture
def run(finished: Path, tmp_path: Path) -> Path:
    """A copy of a finished run, to be damaged."""
    return Path(shutil.copytree(finished, tmp_path / "run"))


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str]) -> Refused:
    """Run a command that must be refused in one line; the line."""

    def call(*argv: str | Path) -> str:
        capsys.readouterr()
        assert main([str(word) for word in argv]) == 2
        err = capsys.readouterr().err
        assert err.startswith("unproject: ") and err.count("\n") == 1, err
        return err

    return call


# Flags


@pytest.mark.parametrize(
    "flags",
    ["--rate nan", "--rate inf", "--rate -1", "--ema-half-life nan", "--minutes inf", "--threads 0", "--threads 100000"]
    + ["--batch 9223372036854775808", "--batch 1000000000", "--steps 0", "--starts 0.5 nan", "--images 0"],
)
def test_odd_flags_leave_no_run(tmp_path: Path, refused: Refused, flags: str) -> None:
    line = refused(*TRAIN, "--views", "predicted", "--out", tmp_path / "run", *flags.split())
    assert not (tmp_path / "run").exists() and "\n" not in line[:-1]


@pytest.mark.parametrize("verb", ["sample", "evaluate", "export"])
def test_a_thousand_million_samples_are_refused(run: Path, tmp_path: Path, refused: Refused, verb: str) -> None:
    out = [] if verb == "evaluate" else ["--out", tmp_path / "x.npz"]
    to = ["--to", "npz"] if verb == "export" else []
    assert "lower n" in refused(verb, run, "--trust", "--n", "1000000000", *to, *out)


@pytest.mark.parametrize("name", ["channels", "rank", "code_size", "size"])
def test_a_generator_without_width(name: str) -> None:
    from unproject.networks import LowRankGenerator, VoxelGenerator

    with pytest.raises(UserError, match=f"{name}=0"):
        LowRankGenerator(**{name: 0})
    with pytest.raises(UserError, match="channels=0"):
        VoxelGenerator(channels=0)


@pytest.mark.parametrize("name", ["Discriminator", "DCGANDiscriminator", "TextureDiscriminator"])
def test_a_discriminator_without_width(name: str) -> None:
    from unproject import networks

    with pytest.raises(UserError, match="channels=0"):
        getattr(networks, name)((3, 32, 32), 1, channels=0)


@pytest.mark.parametrize("gamma", [-1.0, float("nan"), float("inf")])
def test_a_penalty_that_is_none(gamma: float) -> None:
    from unproject.adversarial.penalties import R1R2, GradientPenalty

    for penalty in (R1R2, GradientPenalty):
        with pytest.raises(UserError, match="finite weight"):
            penalty(gamma)
    with pytest.raises(UserError, match="at least 1"):
        R1R2(1.0, every=0)


def test_rounds_that_fill_memory() -> None:
    from unproject.recipes.pairing import frequent_rounds

    with pytest.raises(UserError, match="rounds"):
        frequent_rounds(2**63 - 1, 0.8)


@pytest.mark.parametrize(
    "words", ["not enough memory", "can't allocate memory: you tried", "CUDA out of memory. Tried"]
)
def test_memory_that_is_used_up(run: Path, tmp_path: Path, refused: Refused, words: str, monkeypatch) -> None:
    def full(*arguments: Any, **named: Any) -> None:
        raise RuntimeError(f"[enforce fail] DefaultCPUAllocator: {words} 64 bytes")

    monkeypatch.setattr("unproject.training.Run.sample", full)
    assert "memory is used up" in refused("sample", run, "--trust", "--out", tmp_path / "x.npz")


# Files of ours


@pytest.mark.parametrize("content", [b"\xff", b"{", b"[" * 100_000, b"1" * 5000, b""])
def test_json_that_is_none(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "x.json"
    file.write_bytes(content)
    with pytest.raises(UserError, match="x.json: damaged .*; mend it"):
        read_json(file, "mend it")


def test_what_damaged_files_raise_is_understood_and_nothing_else(tmp_path: Path) -> None:
    for error in (KeyError("x"), OSError("no magic"), ZeroDivisionError()):
        with pytest.raises(UserError, match="damaged"), understood("x", "mend it"):
            raise error
    for kind in (MemoryError, KeyboardInterrupt, FileNotFoundError):
        with pytest.raises(kind), understood("x", "mend it"):
            raise kind(2, "missing", "x")


@pytest.mark.parametrize("verb", ["sample", "resume", "evaluate", "report"])
@pytest.mark.parametrize(
    "content", ["[" * 5000 + "]" * 5000, '{"recipe": 1}', '{"recipe": "", "arguments": [], "resolved": {}}']
)
def test_a_recipe_that_is_none(run: Path, tmp_path: Path, refused: Refused, verb: str, content: str) -> None:
    (run / "recipe.json").write_text(content)
    assert "recipe.json" in refused(verb, run, "--trust", *(["--out", tmp_path / "x.npz"] if verb == "sample" else []))


@pytest.mark.parametrize("value", ["x", [1], {"a": 1}, None, True, 2**63, 1e308, -1])
@pytest.mark.parametrize("name", ["starts", "images", "rate", "views", "seed", "batch", "data"])
def test_arguments_of_other_types(run: Path, refused: Refused, name: str, value: Any) -> None:
    stored = json.loads((run / "recipe.json").read_text())
    stored["arguments"][name] = value
    (run / "recipe.json").write_text(json.dumps(stored))
    status = main(["resume", str(run), "--trust", "--quiet"])
    assert status == 0 or status == 2


def test_a_log_that_is_no_text(run: Path, refused: Refused) -> None:
    (run / "stats.jsonl").write_bytes(b"\xff\xfe{\n")
    with pytest.raises(UserError, match="stats.jsonl: damaged"):
        load(run, trust=True).stats()
    assert main(["resume", str(run), "--trust", "--quiet", "--steps", "3"]) == 0
    assert load(run, trust=True).step == 3


# Checkpoints


def drop(t: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    return {name: value for name, value in t.items() if name != "generator_optimiser/0/exp_avg"}


CHANGES: dict[str, Callable[[dict[str, torch.Tensor]], dict[str, torch.Tensor]]] = {
    "name of two parts": lambda t: {**t, "generator_optimiser/x": torch.zeros(1)},
    "name of four parts": lambda t: {**t, "generator_optimiser/0/step/x": torch.zeros(())},
    "moments of another shape": lambda t: {**t, "generator_optimiser/0/exp_avg": torch.zeros(1, 1, 1)},
    "moments that are missing": drop,
    "moments of a weight that is not there": lambda t: {**t, "generator_optimiser/999/step": torch.zeros(())},
    "moments of steps before the first": lambda t: {**t, "generator_optimiser/0/step": torch.tensor(-1.0)},
    "more dimensions than there are": lambda t: {**t, "average/x": torch.zeros([1] * 64)},
    "infinite counter": lambda t: {**t, "counters/step": torch.tensor(float("inf"), dtype=torch.float64)},
    "endless counter": lambda t: {**t, "counters/lines": torch.tensor(1e300, dtype=torch.float64)},
    "negative counter": lambda t: {**t, "counters/step": torch.tensor(-1.0, dtype=torch.float64)},
    "counters": lambda t: {**t, "counters/step": torch.zeros(3, dtype=torch.float64)},
    "weight that is no number": lambda t: {n: v * math.nan if n.startswith("average/") else v for n, v in t.items()},
    "head that is not there": lambda t: {**t, "panels/0/assignment/heads": t["panels/0/assignment/heads"] + 100},
    "view that is not there": lambda t: {**t, "panels/0/assignment/views": t["panels/0/assignment/views"] - 100},
}  # fmt: skip


@pytest.mark.parametrize("kind", CHANGES)
def test_a_checkpoint_with_odd_entries(run: Path, refused: Refused, kind: str) -> None:
    path = checkpoint.newest(run / "checkpoints")
    with_odd = CHANGES[kind](checkpoint.load(path))
    save_file(with_odd, path, {"format": checkpoint.FORMAT})
    assert "checkpoint" in refused("resume", run, "--trust", "--quiet", "--steps", "4")


def test_a_start_from_averaged_weights_that_do_not_fit(run: Path, tmp_path: Path, refused: Refused) -> None:
    path = checkpoint.newest(run / "checkpoints")
    tensors = {name.replace("average/mapping.0.bias", "average/x"): v for name, v in checkpoint.load(path).items()}
    save_file(tensors, path, {"format": checkpoint.FORMAT})
    assert "cannot start from it" in refused(*TRAIN, "--from", run, "--out", tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_volumes_that_are_no_pictures_leave_no_fits(run: Path, tmp_path: Path, refused: Refused) -> None:
    np.savez(tmp_path / "x.npz", volume=np.triu(np.ones((2, 8, 8, 8), np.float32)))
    words = ["fit", run, tmp_path / "x.npz", "--out", tmp_path / "fits", "--candidates", "2", "--no-novelty", "--trust"]
    assert "holds volumes" in refused(*words) and not (tmp_path / "fits").exists()


# Results of a reproduction


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c["scores"]["s"].update(protocol=["x"]),
        lambda c: c["scores"]["s"].update(protocol="\ud800"),
        lambda c: c["scores"]["s"].pop("n"),
        lambda c: c["scores"]["s"].update(value=float("nan")),
        lambda c: c["environment"].pop("cpus"),
        lambda c: c["environment"].update(command=["train", 3]),
        lambda c: c["environment"].update(started=1.5),
        lambda c: c.update(environment=[]),
        lambda c: c.pop("steps"),
        lambda c: c.update(scores=[]),
    ],
)
def test_a_result_of_other_types(tmp_path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    from unproject.reproduce.result import Result

    made = {
        "command": ["unproject"],
        "started": "",
        "commit": None,
        "processor": "",
        "cpus": 1,
        "threads": 1,
        "cuda": None,
    }
    content = {
        "steps": 1,
        "seconds": 1.0,
        "environment": made,
        "scores": {"s": {"value": 1, "protocol": "", "n": 1, "seed": 0}},
    }
    result = Result(tmp_path, "arm", 0)
    result.file.write_text(json.dumps(content))
    assert result.read() == content
    change(content)
    result.file.write_text(json.dumps(content))
    with pytest.raises(UserError, match="damaged .*; remove it, and its arm is scored again"):
        result.read()


# Processes


def test_of_two_that_train_into_one_folder_one_is_refused(tmp_path: Path) -> None:
    """However close to one another they begin: both have imported everything, and begin at one instant."""
    for attempt in range(5):
        out, begin = tmp_path / f"run-{attempt}", time.time() + 0.1
        children = [raced(out, seed, begin) for seed in (0, 1)]
        statuses = [os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children]
        assert sorted(statuses) == [0, 2]
        assert json.loads((out / "recipe.json").read_text())["resolved"]["seed"] == statuses.index(0)


def raced(out: Path, seed: int, begin: float) -> int:
    """A forked child that trains into a folder from this time on."""
    child = os.fork()
    if not child:
        nowhere = os.open(os.devnull, os.O_RDWR)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        status = 99
        try:
            time.sleep(max(0, begin - time.time()))
            status = main([*TRAIN, "--out", str(out), "--seed", str(seed)])
        finally:
            os._exit(status)
    return child


# Numbers


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("kind", ["figure", "black", "white"])
@pytest.mark.parametrize("views", ["known", "predicted"])
def test_few_pictures_that_are_all_equal(tmp_path: Path, count: int, kind: str, views: str, capsys) -> None:
    """A run, or one line."""
    images = np.zeros((count, 1, 16, 16), np.float32)
    images[:] = {"black": 0, "white": 1, "figure": images}[kind]
    images[:, :, 4:12, 6:9] = images[:, :, 4:12, 6:9] if kind != "figure" else 1
    np.savez(tmp_path / "x.npz", image=images, azimuth=np.zeros(count, np.float32))
    words = [*TRAIN, "--views", views, "--data", str(tmp_path / "x.npz"), "--out", str(tmp_path / "run")]
    status = main(words)
    err = capsys.readouterr().err
    assert status == 0 or (status == 2 and err.count("\n") == 1), err


@pytest.mark.parametrize("flags", [["--batch", "1"], ["--rate", "10"]])
def test_a_batch_of_one_and_a_rate_of_ten(tmp_path: Path, flags: list[str], capsys) -> None:
    status = main([*TRAIN, "--steps", "40", "--out", str(tmp_path / "run"), *flags])
    err = capsys.readouterr().err
    assert status == 0 or (status == 2 and "unproject: training " in err.splitlines()[-1]), err
