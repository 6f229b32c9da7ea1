"""The progress bar says which time has passed and which remains; the log is whole whatever became of the machine."""

from __future__ import annotations

import io
import os
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console
from toy import toy

from unproject.training import checkpoint, train
from unproject.training.recorder import Recorder
from unproject.training.run_directory import read_log


def rendered(recorder: Recorder) -> str:
    console = Console(file=io.StringIO(), width=160)
    with console.capture() as captured:
        console.print(recorder.bar.get_renderable())
    return captured.get()


def test_the_bar_names_the_time_elapsed_and_the_time_left(tmp_path: Path) -> None:
    recorder, now = Recorder(tmp_path), 0.0
    recorder.bar.get_time = recorder.bar.tasks[0]._get_time = lambda: now
    recorder.bar.reset(recorder.task)
    for now in map(float, range(0, 197, 4)):
        recorder.show(now / 199.5, "step 98")
    recorder.stream.close()
    assert " 98% · 0:03:16 elapsed · 0:00:04 left step 98" in rendered(recorder)


@pytest.mark.parametrize(
    ("left", "kept"), [('{"step": 1}\n{"step": 2}\n{"step": 3, "sec', 2), ('{"step": 1}\n', 1), ('{"st', 0), (None, 0)]
)
def test_a_log_that_is_shorter_than_its_checkpoint_says_goes_on_with_a_line_of_its_own(
    tmp_path: Path, left: str | None, kept: int
) -> None:
    """As after a power failure, of five lines."""
    if left is not None:
        (tmp_path / "stats.jsonl").write_text(left)
    with Recorder(tmp_path, lines=5, quiet=True) as recorder:
        recorder.write(9, 1.0)
    assert recorder.lines == kept + 1
    assert [line["step"] for line in read_log(tmp_path / "stats.jsonl")] == [1, 2][:kept] + [9]


def test_the_log_is_on_the_disk_before_a_checkpoint_counts_its_lines(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes: list[tuple[int, int]] = []  # what is there of the log, and what of it was brought to the disk
    synced, fsync, save = 0, os.fsync, checkpoint.save

    def noted(descriptor: int) -> None:
        nonlocal synced
        fsync(descriptor)
        log, found = tmp_path / "stats.jsonl", os.fstat(descriptor)
        if log.exists() and log.stat().st_ino == found.st_ino:
            synced = found.st_size

    def saved(*arguments: Any) -> Path:
        sizes.append(((tmp_path / "stats.jsonl").stat().st_size, synced))
        return save(*arguments)

    monkeypatch.setattr(os, "fsync", noted)
    monkeypatch.setattr(checkpoint, "save", saved)
    train(toy(steps=4, checkpoint_every=2), tmp_path, quiet=True)
    assert len(sizes) == 2 and all(there == on_disk > 0 for there, on_disk in sizes)
