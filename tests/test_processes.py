"""Several processes started by torchrun: they average gradients, stay equal, and one of them writes."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from unproject.cli import main
from unproject.training import checkpoint, load

HERE = Path(__file__).parent / "training"


ENVIRONMENT = {**os.environ, "OMP_NUM_THREADS": "1", "CUDA_VISIBLE_DEVICES": ""}
TOY = f"{HERE / 'toy.py'}:toy"


def run(command: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, env=ENVIRONMENT, capture_output=True, text=True, timeout=200, check=False)


def script(name: str, folder: Path) -> None:
    done = run([sys.executable, str(HERE / name), str(folder)])
    assert done.returncode == 0, done.stderr


@pytest.fixture
def agent(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """What `--processes` starts them with runs in this process, which has torch already."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "")
    handlers = {
        number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
    }
    yield
    for number, handler in handlers.items():
        signal.signal(number, handler)


def lines(out: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (out / "stats.jsonl").read_text().splitlines()]


def steps(out: Path) -> list[int]:
    return [line["step"] for line in lines(out)]


@pytest.mark.slow
def test_the_command_trains_in_two_processes_and_goes_on_in_three(
    tmp_path: Path, agent: None, capfd: pytest.CaptureFixture[str], request: pytest.FixtureRequest
) -> None:
    """In two that are new, and in three that are forked."""
    out = tmp_path / "run"
    assert main(["train", TOY, "--steps", "4", "--quiet", "--out", str(out), "--processes=2"]) == 0
    assert load(out, trust=True).step == 4
    assert len(checkpoint.list_checkpoints(out / "checkpoints")) == 1 and len(list((out / "samples").iterdir())) == 1
    assert steps(out) == [1, 2, 3]  # three rounds of assignment, each written once
    assert sorted(path.name for path in out.iterdir()) == [
        "checkpoints", "environment.json", "recipe.json", "report.html", "samples", "stats.jsonl", "verdict.json"
    ]  # fmt: skip
    assert capfd.readouterr().out.count("4 steps") == 1
    request.getfixturevalue("forked")
    assert main(["resume", str(out), "--steps", "6", "--trust", "--quiet", "--processes", "3"]) == 0
    assert load(out, trust=True).step == 6


@pytest.mark.slow
def test_processes_agree_average_and_stay_equal(tmp_path: Path, forked: None) -> None:
    script("averaging.py", tmp_path)
    a, b = (json.loads((tmp_path / f"rank-{rank}.json").read_text()) for rank in (0, 1))
    assert a["difference"] <= 1e-5 and b["difference"] <= 1e-5 and a["size"] > 1e-3
    assert a["sums"] == b["sums"] and a["views"] == b["views"]
    assert a["predictor"] == b["predictor"] and a["predicted"] == b["predicted"]
    assert a["started"] == b["started"] and len(set(a["started"])) > 1
    assert a["copied"] == b["copied"] == [0, 0]
    assert a["wide"] == b["wide"] == [200, 300] and a["averaged"] == b["averaged"] == 0.1
    assert a["agreed"] == b["agreed"] == [True, False]
    assert a["diversity"] == b["diversity"] == pytest.approx(0.5)
    assert a["writes"] == [1, 2, 2, "stats.jsonl"] and b["writes"] == [0, 0, 0, "null"]
    assert steps(tmp_path / "run") == [1, 2, 2, 3, 4]


LOSSES = ("loss_d", "loss_g", "penalty")
TOLERANCE = 5e-4


def differences(folder: Path, other: Path) -> dict[str, float]:
    """Return the largest difference of a loss of each recipe of the second folder from the first one's."""
    found = {}
    for out in sorted(other.iterdir()):
        pairs = zip(lines(folder / out.name), lines(out), strict=True)
        found[out.name] = max(abs(a[k] - b[k]) for a, b in pairs for k in LOSSES if k in a)
    return found


@pytest.mark.slow
def test_two_batches_of_b_are_one_of_2b(tmp_path: Path, forked: None) -> None:
    """The law, and the mutant that draws in each process alone."""
    script("equal_batches.py", tmp_path)
    equal, broken = (differences(tmp_path / "whole", tmp_path / name) for name in ("halves", "mutant"))
    assert len(equal) == 6 and max(equal.values()) < TOLERANCE, equal
    assert max(broken.values()) > 10 * TOLERANCE, broken


@pytest.mark.slow
def test_a_run_of_two_processes_that_was_killed_goes_on_in_one_and_in_two(
    tmp_path: Path, agent: None, forked: None
) -> None:
    killed, words = tmp_path / "killed", ["--steps", "400", "--checkpoint-every", "2", "--quiet"]
    torchrun = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command = [*torchrun, "-m", "unproject", "train", TOY, *words, "--out", str(killed)]
    with subprocess.Popen(command, env=ENVIRONMENT, stdout=-3, stderr=-3, start_new_session=True) as process:
        while not checkpoint.list_checkpoints(killed / "checkpoints"):
            assert process.poll() is None
            time.sleep(0.05)
        for rank in children(process.pid):
            with suppress(ProcessLookupError):  # the agent ends the second once it has seen the end of the first
                os.kill(rank, signal.SIGKILL)
    assert process.returncode != 0
    done = int(checkpoint.newest(killed / "checkpoints").stem.removeprefix("step-"))
    shutil.copytree(killed, tmp_path / "in-one")
    words = ["--steps", str(done + 4), "--trust", "--quiet"]
    assert main(["resume", str(tmp_path / "in-one"), *words]) == 0
    assert main(["resume", str(killed), *words, "--processes", "2"]) == 0
    for out in (tmp_path / "in-one", killed):
        assert load(out).step == done + 4 and not list(out.rglob("*.tmp*"))


@pytest.mark.slow
def test_processes_save_and_leave_when_the_one_that_started_them_is_killed(tmp_path: Path, forked: None) -> None:
    run = tmp_path / "run"
    words = ["--steps", "100000000", "--quiet", "--out", str(run), "--processes", "2"]
    command = [sys.executable, "-m", "unproject", "train", TOY, *words]
    with subprocess.Popen(command, env=ENVIRONMENT, stdout=-3, stderr=-3, start_new_session=True) as process:
        while not ((run / "stats.jsonl").exists() and (run / "stats.jsonl").stat().st_size):
            assert process.poll() is None
            time.sleep(0.05)
        ranks = children(process.pid)
        process.kill()
    assert len(ranks) == 2 and until_gone(ranks) and load(run, trust=True).step > 0


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_processes_that_are_asked_to_stop_save_and_end_without_a_word_of_torch(
    tmp_path: Path, forked: None, number: signal.Signals
) -> None:
    """Ctrl-C reaches the command alone, which hands it on; a manager sends SIGTERM to each process, which hears two."""
    run = tmp_path / "run"
    words = ["--steps", "100000000", "--quiet", "--out", str(run), "--processes", "2"]
    command = [sys.executable, "-m", "unproject", "train", TOY, *words]
    with subprocess.Popen(command, env=ENVIRONMENT, stdout=-1, stderr=-1, text=True, start_new_session=True) as process:
        while not ((run / "stats.jsonl").exists() and (run / "stats.jsonl").stat().st_size):
            assert process.poll() is None
            time.sleep(0.05)
        for one in [*(children(process.pid) if number == signal.SIGTERM else []), process.pid]:
            os.kill(one, number)
        said, wrong = process.communicate(timeout=100)
    assert process.returncode == 0 and all(line.startswith("warning: ") for line in wrong.splitlines())
    step = load(run, trust=True).step
    assert step > 0 and (number == signal.SIGTERM or f"{step} steps (stopped; unproject resume" in said)


def test_a_child_of_a_killed_reproduction_stops(tmp_path: Path, forked: None) -> None:
    """As by SIGTERM: it leaves a checkpoint, and can be resumed."""
    words = [
        sys.executable,
        "-m",
        "unproject",
        "train",
        TOY,
        "--steps",
        "100000000",
        "--quiet",
        "--out",
        str(tmp_path / "run"),
    ]
    code = "import os, subprocess, time\nenv = {**os.environ, 'UNPROJECT_PARENT': str(os.getpid())}\n"
    code += f"print(subprocess.Popen({words!r}, env=env).pid, flush=True)\ntime.sleep(1000)"
    parent = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert parent.stdout is not None
    child = int(parent.stdout.readline())
    stats = tmp_path / "run" / "stats.jsonl"
    while not (stats.exists() and stats.stat().st_size):
        time.sleep(0.1)
    parent.kill()
    parent.communicate()
    assert until_gone([child]) and load(tmp_path / "run", trust=True).step > 0


def alive(process: int) -> bool:
    """Whether it runs: one that ended and was not waited for is none."""
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:  # it has ended, maybe while it was asked for
        return False


def until_gone(processes: list[int]) -> bool:
    """Whether all of them end, for which a busy machine may take its time."""
    for _ in range(1500):
        if not any(map(alive, processes)):
            return True
        time.sleep(0.1)
    return False


def children(pid: int) -> list[int]:
    """Return the processes that a process has started."""
    return [int(child) for child in Path(f"/proc/{pid}/task/{pid}/children").read_text().split()]


FAILING = """
import os, signal
from unproject.training import Recipe
from toy import toy
from unproject._types import UserError

def fails(*, how: str = "", steps: int = 4) -> Recipe:
    \"\"\"A recipe that fails in one process, in a way that is asked for.\"\"\"
    if os.environ.get("RANK") in ("1", None) or how == "all":
        if how in ("all", "one"):
            raise UserError("data: not here; give others")
        if how == "killed":
            os.kill(os.getpid(), signal.SIGKILL)
        if how == "amid":
            import unproject.training.trainer as trainer
            trainer.Trainer._finish_step = lambda *_: (_ for _ in ()).throw(UserError("data: gone; give others"))
    return toy(steps=steps)
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "line", "status"),
    [
        ("all", "unproject: data: not here; give others", 2),
        ("one", "unproject: data: not here; give others", 2),
        ("amid", "unproject: data: gone; give others", 2),
        ("killed", "unproject: process 1 of 2 was ended by signal 9; resume goes on from the last checkpoint", 1),
    ],
)
def test_one_process_that_fails_ends_all_with_one_line(
    tmp_path: Path,
    agent: None,
    forked: None,
    how: str,
    line: str,
    status: int,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "failing.py").write_text(FAILING)
    (tmp_path / "temporary").mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.syspath_prepend(HERE)
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")]))
    words = ["--how", how, "--out", str(tmp_path / "run"), "--quiet", "--processes", "2"]
    found = main(["train", f"{tmp_path / 'failing.py'}:fails", *words])
    assert (capfd.readouterr().err.splitlines(), found) == ([line], status)
    assert not list((tmp_path / "temporary").glob("torchelastic*"))


@pytest.mark.parametrize("verb", ["train", "resume"])
def test_how_many_processes_there_can_be(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([verb, "shapes" if verb == "train" else "runs/a", "--processes", "0"]) == 2
    assert capsys.readouterr().err == (
        "unproject: --processes 0: give 1 to 1024, one for each GPU, or for a part of the processors\n"
    )
