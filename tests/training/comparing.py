"""What two runs that computed the same have in common."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from unproject.training import checkpoint


def stats(run: Path) -> list[dict[str, Any]]:
    """The lines of stats.jsonl less `seconds`."""
    lines = [json.loads(line) for line in (run / "stats.jsonl").read_text().splitlines()]
    return [{k: v for k, v in line.items() if k != "seconds"} for line in lines]


def final(run: Path) -> dict[str, Tensor]:
    """The tensors of the newest checkpoint less the clock's."""
    tensors = checkpoint.load(checkpoint.newest(run / "checkpoints"))
    return {k: v for k, v in tensors.items() if k != "counters/seconds"}


def differences(a: Path, b: Path) -> list[str]:
    """Where two runs differ in any bit; empty if they are the same run."""
    one, two = final(a), final(b)
    found = sorted(set(one) ^ set(two))
    found += [name for name in one if name in two and not torch.equal(one[name], two[name])]
    return found + ([] if stats(a) == stats(b) else ["stats.jsonl"])


def temporaries(run: Path) -> list[str]:
    """Half-written files."""
    return sorted(path.name for path in run.rglob(".*"))
