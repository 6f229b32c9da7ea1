"""The log of a run, read again and again while it is written."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import pytest

from unproject.report.log import Log


def line(step: int, **more: Any) -> str:
    return json.dumps({"step": step, "seconds": 1.0, **more}) + "\n"


def steps(log: Log) -> list[int]:
    return [one["step"] for one in log.read()[0]]


def test_what_is_added_is_read_and_what_was_read_is_not_read_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file, loads, read = tmp_path / "stats.jsonl", json.loads, []
    monkeypatch.setattr("unproject.report.log.json.loads", lambda text: read.append(text) or loads(text))
    file.write_text(line(1) + "damaged\n" + line(2))
    log = Log(file)
    assert (steps(log), log.read()[1], len(read)) == ([1, 2], 1, 3)
    with file.open("a") as stream:
        stream.write(line(3) + line(4)[:-5])
    assert (steps(log), log.read()[1]) == ([1, 2, 3], 2)
    with file.open("a") as stream:
        stream.write(line(4)[-5:])
    del read[:]
    assert (steps(log), log.read()[1], len(read)) == ([1, 2, 3, 4], 1, 1)


def test_steps_below_zero_are_damaged(tmp_path: Path) -> None:
    (tmp_path / "stats.jsonl").write_text(line(-7, loss=1) + line(0) + line(-5, loss=2))
    log = Log(tmp_path / "stats.jsonl")
    assert (steps(log), log.read()[1]) == ([0], 2)


def test_a_last_line_without_its_end_counts(tmp_path: Path) -> None:
    (tmp_path / "stats.jsonl").write_text(line(1) + line(2).strip())
    assert steps(Log(tmp_path / "stats.jsonl")) == [1, 2]


WRITTEN_ANEW = {
    "fewer lines": line(1, loss=1),
    "more lines": "".join(line(k, loss=2) for k in range(1, 9)),
    "as many, and more": line(1, loss=1) + line(3) + line(4),
}


@pytest.mark.parametrize("content", WRITTEN_ANEW.values(), ids=list(WRITTEN_ANEW))
@pytest.mark.parametrize("in_place", [False, True])
def test_a_log_that_is_written_anew_is_read_anew(tmp_path: Path, content: str, in_place: bool) -> None:
    """In place, as an inode may be used again, it is told by its length or its first lines."""
    file = tmp_path / "stats.jsonl"
    file.write_text(line(1, loss=1) + line(2))
    log = Log(file)
    assert steps(log) == [1, 2]
    other = tmp_path / "other"
    other.write_text(content)
    file.write_text(content) if in_place else os.replace(other, file)
    assert log.read() == Log(file).read()


def test_a_log_that_went_back_and_has_grown_again_is_read_anew(tmp_path: Path) -> None:
    """Its first lines are those of before: it is another file."""
    file, same = tmp_path / "stats.jsonl", line(1, says="x" * 300)
    file.write_text(same + line(2))
    log = Log(file)
    assert steps(log) == [1, 2]
    (tmp_path / "other").write_text(same + line(3) + line(4))
    os.replace(tmp_path / "other", file)
    assert steps(log) == [1, 3, 4]
