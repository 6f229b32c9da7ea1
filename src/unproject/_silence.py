"""Silence: stderr turned off while libraries decode what is damaged."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_silence = threading.Lock()
_silent: list[int] = []
"""The descriptor that stderr had, once for each thread that is in `silenced`."""


@contextmanager
def silenced() -> Iterator[None]:
    """Keep the libraries that decode pictures from writing to stderr: what is wrong is said once, by us.

    stderr is the process's: the first thread that comes turns it off, the last that leaves turns it on again.
    """
    with _silence:
        _silent.append(_silent[0] if _silent else _turned_off(2))
    try:
        yield
    finally:
        with _silence:
            stderr = _silent.pop()
            if not _silent and stderr != CLOSED:
                os.dup2(stderr, 2)
                os.close(stderr)


CLOSED = -1


def _turned_off(descriptor: int) -> int:
    """Let a descriptor write nowhere; return one that writes where it did, or `CLOSED` if it was closed."""
    try:
        kept = os.dup(descriptor)
    except OSError:
        return CLOSED
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, descriptor)
    os.close(nowhere)
    return kept
