"""`unproject check`: a user's file, good or bad."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from unproject.cli import main

PARTS = '''
from dataclasses import dataclass
import torch
import unproject as up

class Depth(up.Projection):
    """Front-most depth."""
    def forward(self, x, *, azimuth):
        return up.ops.expected_depth(up.ops.rotate_y(x, azimuth))

class OverTheBatch(up.Projection):
    def forward(self, x, *, azimuth):
        return up.ops.rotate_y(x, azimuth) - x.mean()

class Takes(up.Projection):
    def __init__(self, size): self.size = size
    def forward(self, x): return x

class Broken(up.Uniform):
    def sample(self, n, rng): raise RuntimeError("no dice")

depth = up.Observation("depth", Depth(), up.Uniform("azimuth", 0, 6.28))
everything = (depth, up.Observation("itself", up.Identity(), up.Product()))
bins = up.Bins("azimuth", 16)
broken = up.Observation("broken", Depth(), Broken("azimuth", 0, 1))
def factory(): return Depth()
number = 3
nothing = []
'''


@pytest.fixture
def parts(tmp_path: Path) -> str:
    path = tmp_path / "parts.py"
    path.write_text(PARTS, encoding="utf-8")
    return str(path)


@pytest.mark.parametrize("name", ["depth", "Depth", "factory", "bins", "everything"])
def test_good_parts_pass(parts: str, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", f"{parts}:{name}"]) == 0
    text = capsys.readouterr().out
    assert "FAILED" not in text and "laws hold" in text


def test_a_module_that_is_installed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", "unproject.projections.base:Identity"]) == 0
    assert "superposition" in capsys.readouterr().out


def test_a_bad_part_fails_by_name(parts: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", f"{parts}:OverTheBatch"]) == 1
    failed = [line for line in capsys.readouterr().out.splitlines() if "FAILED" in line]
    assert len(failed) == 1 and "batched" in failed[0]


@pytest.mark.parametrize("name, status", [("depth", 0), ("OverTheBatch", 1)])
def test_json(parts: str, name: str, status: int, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", f"{parts}:{name}", "--json"]) == status
    said = json.loads(capsys.readouterr().out)
    laws = [law for part in said["parts"].values() for law in part]
    assert said["passed"] == all(law["passed"] for law in laws) == (status == 0)
    assert {"name", "passed", "detail"} == set(laws[0])


@pytest.mark.parametrize(
    "name, said",
    [
        ("number", "give one of these"),
        ("Takes", "missing 1 required positional argument"),
        ("broken", "no dice"),
        ("deph", "Perhaps you meant 'depth'"),
        ("nothing", "is empty: name a part"),
    ],
)
def test_what_cannot_be_tried_is_one_line(parts: str, name: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check", f"{parts}:{name}"]) == 2
    err = capsys.readouterr().err
    assert err.startswith("unproject: ") and err.count("\n") == 1 and said in err


def test_no_object(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["check"]) == 2
    assert "PART" in capsys.readouterr().err
