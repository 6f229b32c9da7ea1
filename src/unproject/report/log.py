"""Log: the lines of stats.jsonl, each of which is read once, however often one looks while a run trains."""

from __future__ import annotations

import json
import os
import threading
from pathlib import Path
from typing import Any

from ..training.budget import number

HEAD = 256
"""Bytes at the beginning, by which the log of a run that was made again is told from that before."""


class Log:
    """The log of a run, which grows at its end, or is written anew when training goes back to a checkpoint.

    Args:
        file: stats.jsonl.
    """

    def __init__(self, file: Path) -> None:
        self.file = file
        self._lock = threading.Lock()
        self._begin(0)

    def _begin(self, inode: int) -> None:
        self._inode, self._head, self._end, self._damaged = inode, b"", 0, 0
        self._lines: list[dict[str, Any]] = []

    def read(self) -> tuple[list[dict[str, Any]], int]:
        """Return the lines as they are now, and how many were damaged and left out.

        Raises:
            OSError: if there is no such file.
        """
        with self._lock, self.file.open("rb") as stream:
            found, head = os.fstat(stream.fileno()), stream.read(len(self._head))
            if found.st_ino != self._inode or found.st_size < self._end or head != self._head:
                self._begin(found.st_ino)
            stream.seek(self._end)
            whole, newline, rest = stream.read().rpartition(b"\n")
            lines, damaged = _parsed(whole)
            if not self._end:
                self._head = whole[:HEAD]
            self._end += len(whole) + len(newline)
            self._lines += lines
            self._damaged += damaged
            lines, damaged = _parsed(rest)  # it may still be written further
            return self._lines + lines, self._damaged + damaged


def _parsed(content: bytes) -> tuple[list[dict[str, Any]], int]:
    """Return the lines that have a step, 0 or more, and how many others there are."""
    texts = content.decode("utf-8", "replace").splitlines()
    lines = []
    for text in texts:
        try:
            line = json.loads(text)
        except (ValueError, RecursionError):
            continue
        step = number(line.get("step")) if isinstance(line, dict) else None
        if step is not None and step >= 0:
            lines.append(line)
    return lines, len(texts) - len(lines)
