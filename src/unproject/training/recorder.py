"""Write a run's log to disk, for TensorBoard too if the run has its folder, and show its progress on the screen."""

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

from .._files import atomic_path, naming
from .event_file import FOLDER, EventFile
from .run_directory import read_log


class Recorder:
    """Append lines to stats.jsonl and show a progress bar.

    Args:
        path: the run directory.
        lines: number of lines of stats.jsonl when the checkpoint was written; later lines are dropped.
        leads: whether this process writes the log and shows the bar.
        quiet: show no bar.
        tell: called with each line that is written.
    """

    def __init__(
        self,
        path: Path,
        lines: int = 0,
        leads: bool = True,
        quiet: bool = False,
        tell: Callable[[dict[str, Any]], object] | None = None,
    ) -> None:
        self.tell = tell if leads else None
        self.file = path / "stats.jsonl" if leads else Path(os.devnull)
        self.lines = self._keep(lines) if leads else lines
        self.stream = self.file.open("a", encoding="utf-8")
        self.events = EventFile(path, read_log(self.file)) if leads and (path / FOLDER).is_dir() else None
        self.bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:3.0f}% ·"),
            TimeElapsedColumn(),
            TextColumn("elapsed ·"),
            TimeRemainingColumn(),
            TextColumn("left"),
            TextColumn("{task.fields[note]}"),
            console=Console(file=sys.stderr, quiet=not leads),
            disable=quiet or not leads,
        )
        self.task = self.bar.add_task("training", total=1.0, note="")

    def _keep(self, lines: int) -> int:
        """Drop all but the first `lines` lines, and the last if it is torn; return how many are left.

        The step of a line does not say whether to keep it: a rollback repeats steps, and events have the step of a
        checkpoint.
        """
        if not self.file.exists():
            return 0
        kept = self.file.read_bytes().splitlines(keepends=True)[:lines]  # a damaged line is no text
        if kept and not kept[-1].endswith(b"\n"):  # the next would be glued to it
            kept.pop()
        with atomic_path(self.file) as temporary:
            temporary.write_bytes(b"".join(kept))
        return len(kept)

    def __enter__(self) -> Recorder:
        self.bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.bar.stop()
        with suppress(OSError):  # a line that did not fit on a full disk is still in the buffer
            self.stream.close()
        if self.events:
            with suppress(OSError):
                self.events.close()

    def write(self, step: int, seconds: float, **values: Any) -> None:
        """Append one line to stats.jsonl."""
        line = {"step": step, "seconds": round(seconds, 3), **values}
        with naming(self.file):
            self.stream.write(json.dumps(line) + "\n")
            self.stream.flush()
            if self.events:
                self.events.write(line)
        self.lines += 1
        if self.tell is not None:
            self.tell(line)

    def synchronise(self) -> None:
        """Bring the log to the disk, before a checkpoint is there that counts its lines."""
        with naming(self.file):
            os.fsync(self.stream.fileno())

    def show(self, progress: float, note: str) -> None:
        """Move the bar to a part of the budget, 0 to 1, with a note behind it."""
        self.bar.update(self.task, completed=min(progress, 1.0), note=note)

    def say(self, message: str) -> None:
        """Print a line above the bar."""
        self.bar.console.print(message, highlight=False, soft_wrap=True)

    def subtask(self, name: str, total: int) -> Callable[[int, float], None]:
        """Show a second bar; the function returned moves it to (done, loss) and removes it at `total`."""
        task = self.bar.add_task(name, total=total, note="")

        def update(done: int, loss: float) -> None:
            self.bar.update(task, completed=done, note=f"loss {loss:.3f}")
            if done >= total:
                self.bar.remove_task(task)

        return update
