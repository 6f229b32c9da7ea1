"""Recorder: the run's log on disk and its progress on the screen."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from .._files import atomic_path
from .run_directory import naming


class Recorder:
    """Appends to stats.jsonl and shows a bar. Lines after the checkpoint that a run resumes from are dropped.

    Args:
        path: the run directory.
        lines: how many lines of stats.jsonl the checkpoint knows of.
        leads: whether this process writes and shows anything at all.
        quiet: no bar.
    """

    def __init__(self, path: Path, lines: int = 0, leads: bool = True, quiet: bool = False) -> None:
        self.file = path / "stats.jsonl" if leads else Path(os.devnull)
        self.lines = lines
        if leads:
            self._keep(lines)
        self.stream = self.file.open("a", encoding="utf-8")
        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f}%"),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            TextColumn("{task.fields[note]}"),
            console=Console(file=sys.stderr, quiet=not leads),
            disable=quiet or not leads,
        )
        self.task = self.bar.add_task("training", total=1.0, note="")

    def _keep(self, lines: int) -> None:
        """Steps would not tell which lines: a rescue goes back, and events share the step of a checkpoint."""
        if not self.file.exists():
            return
        kept = self.file.read_text(encoding="utf-8").splitlines(keepends=True)[:lines]
        with naming(self.file), atomic_path(self.file) as temporary:
            temporary.write_text("".join(kept), encoding="utf-8")

    def __enter__(self) -> Recorder:
        self.bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bar.stop()
        with suppress(OSError):  # what a full disk refused once is still in the buffer
            self.stream.close()

    def write(self, step: int, seconds: float, **values: Any) -> None:
        """One line of stats.jsonl."""
        with naming(self.file):
            self.stream.write(json.dumps({"step": step, "seconds": round(seconds, 3), **values}) + "\n")
            self.stream.flush()
        self.lines += 1

    def show(self, progress: float, note: str) -> None:
        """Move the bar."""
        self.bar.update(self.task, completed=min(progress, 1.0), note=note)

    def say(self, message: str) -> None:
        """A line above the bar."""
        self.bar.console.print(message, highlight=False)

    def subtask(self, name: str, total: int) -> Callable[[int, float], None]:
        """A second bar for something long inside training; call it with (done, loss); it leaves at `total`."""
        task = self.bar.add_task(name, total=total, note="")

        def update(done: int, loss: float) -> None:
            self.bar.update(task, completed=done, note=f"loss {loss:.3f}")
            if done >= total:
                self.bar.remove_task(task)

        return update
