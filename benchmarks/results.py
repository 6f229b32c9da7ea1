"""How results are written: into docs/results, and as a line of JSON an arm, with where they come from."""

from __future__ import annotations

import json
import math
import os
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import torch

from unproject.training import Run, recovery, trainer
from unproject.training.run_directory import environment


def write(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")


def origin() -> dict[str, str]:
    """Return the commit, the machine and the version of torch."""
    head = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True, check=False)
    return {
        "commit": head.stdout.strip(),
        "machine": f"{os.cpu_count()} cores, {environment()['processor']}",
        "torch": torch.__version__,
    }


def count_cpu_seconds() -> None:
    """Count budgets in CPU seconds of this process: with one thread those of a quiet machine, whatever runs beside."""
    clock = SimpleNamespace(monotonic=time.process_time)
    vars(trainer)["time"] = vars(recovery)["time"] = clock


def finished(run: Run) -> Run:
    """Return the run; raise SystemExit if it was stopped, by Ctrl-C or SIGTERM: what it has so far is no result."""
    if not run.complete:
        raise SystemExit(f"{run.path}: stopped after step {run.step}; the same command goes on")
    return run


def minutes_of(run: Run) -> float:
    """Return the minutes of training up to the last line of the log."""
    return round(max((line["seconds"] for line in run.stats()), default=0.0) / 60, 1)


def budget_of(row: Mapping[str, Any]) -> float:
    """Return the budget of a result in minutes; of those that do not say it, what they took."""
    return row.get("budget", row.get("minutes", math.nan))


class Results:
    """Results of arms, a line of JSON each: an arm that is there need not be run again.

    A line that lacks a field of the key, as those of before it was one, is read, and is of no arm that is asked for.

    Args:
        path: results.jsonl; made with the first result.
        key: the fields that name an arm.
    """

    def __init__(self, path: Path, key: Sequence[str]) -> None:
        self.path, self.key = path, tuple(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        self.rows: list[dict[str, Any]] = (
            [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.exists() else []
        )

    def has(self, *arm: object) -> bool:
        return any(tuple(row.get(name) for name in self.key) == arm for row in self.rows)

    def add(self, row: dict[str, Any]) -> None:
        """Write a result with its origin, and show it."""
        self.rows.append({**row, **origin()})
        line = json.dumps(self.rows[-1])
        with self.path.open("a", encoding="utf-8") as file:
            file.write(line + "\n")
        print(line, flush=True)
