"""Several processes started by torchrun: they average gradients, stay equal, and one of them writes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from unproject.training import checkpoint, load

HERE = Path(__file__).parent / "training"
TORCHRUN = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]


def torchrun(*argv: str | Path) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "CUDA_VISIBLE_DEVICES": ""}
    command = [*TORCHRUN, *map(str, argv)]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200, check=False)


def steps(run: Path) -> list[int]:
    return [json.loads(line)["step"] for line in (run / "stats.jsonl").read_text().splitlines()]


@pytest.mark.slow
def test_the_command_trains_in_two_processes(tmp_path: Path) -> None:
    run = tmp_path / "run"
    recipe = f"{HERE / 'toy.py'}:toy"
    done = torchrun("-m", "unproject", "train", recipe, "--steps", "4", "--quiet", "--out", run)
    assert done.returncode == 0, done.stderr
    assert load(run).step == 4
    assert len(checkpoint.list_checkpoints(run / "checkpoints")) == 1 and len(list((run / "samples").iterdir())) == 1
    assert steps(run) == [1, 2, 3]  # three rounds of assignment, each written once
    assert sorted(path.name for path in run.iterdir()) == [
        "checkpoints", "environment.json", "recipe.json", "report.html", "samples", "stats.jsonl", "verdict.json"
    ]  # fmt: skip
    assert done.stdout.count("4 steps") == 1


@pytest.mark.slow
def test_processes_agree_average_and_stay_equal(tmp_path: Path) -> None:
    done = torchrun(HERE / "averaging.py", tmp_path)
    assert done.returncode == 0, done.stderr
    a, b = (json.loads((tmp_path / f"rank-{rank}.json").read_text()) for rank in (0, 1))
    assert a["difference"] <= 1e-5 and b["difference"] <= 1e-5 and a["size"] > 1e-3
    assert a["sums"] == b["sums"] and a["views"] == b["views"]
    assert a["predictor"] == b["predictor"] and a["predicted"] == b["predicted"]
    assert a["copied"] == b["copied"] == [0, 0]
    assert a["agreed"] == b["agreed"] == [True, False]
    assert a["diversity"] == b["diversity"] == pytest.approx(0.5)
    assert a["writes"] == [1, 2, 2, "stats.jsonl"] and b["writes"] == [0, 0, 0, "null"]
    assert steps(tmp_path / "run") == [1, 2, 2, 3, 4]
