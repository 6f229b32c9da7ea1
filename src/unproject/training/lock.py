"""The lock of a run directory: one process trains a run at a time, and others can see that it does."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from .._types import UserError

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

WAITS = (0.01, 0.1, 0.5, 0.0)
"""Seconds to wait for a lock again and again: `is_locked` holds it for a moment."""


@contextmanager
def locked(path: Path, leads: bool = True) -> Iterator[None]:
    """Keep every other process from training this run meanwhile; the lock goes with the process, however it ends.

    Where the system or the disk has no locks, nothing is kept away.

    Raises:
        UserError: if another process trains it.
    """
    if not leads or fcntl is None:
        yield
        return
    folder = os.open(path, os.O_RDONLY)  # the folder itself: it is there before anything is written into it
    try:
        for wait in WAITS:
            if _try_lock(folder) is not False:
                break
            time.sleep(wait)
        else:
            raise UserError(f"{path}: another process is training this run; wait for it, or stop it")
        yield
    finally:
        os.close(folder)


def is_locked(path: Path) -> bool | None:
    """Return whether a process trains this run now; None where the system or the disk has no locks."""
    folder = os.open(path, os.O_RDONLY)
    try:
        acquired = _try_lock(folder)
        return None if acquired is None else not acquired
    finally:
        os.close(folder)


def _try_lock(folder: int) -> bool | None:
    """Take the lock of an open folder until it is closed; return whether it was free, or None if there are no locks."""
    if fcntl is None:
        return None
    try:
        fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError:
        return None
    return True
