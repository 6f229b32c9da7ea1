"""Every picture of a folder, read on all cores: what it became, or why it cannot be used."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from ..._cores import cores
from ..._pictures import UnusablePicture
from ..._types import UserError

MIN_FOR_WORKERS, AT_ONCE = 256, 16
"""Pictures from which on it pays to start workers, and those that a worker takes at once."""


class Item(NamedTuple):
    """A picture as it is stored, (C, H, W) uint8 or float32, how it was read, and the sides it had, in pixels.

    An array, not a tensor: workers would send each tensor in shared memory of its own. Of silhouettes, whether several
    large parts are seen, and whether the border seems to cut the object off.
    """

    values: np.ndarray
    read_as: str
    width: int
    height: int
    several: bool = False
    cut: bool = False


Read = Callable[[Path], Item]


@dataclass(frozen=True)
class Survey:
    """What each picture of a folder became, or why it cannot be used."""

    used: dict[str, Item] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)


def survey(path: Path, files: Sequence[Path], read: Read, strict: bool) -> Survey:
    """Read the pictures `files` below the folder `path`.

    Raises:
        UserError: with `strict`, for the first one that cannot be used.
    """
    found = Survey()
    for file, item in items_of(files, read, strict):
        name = file.relative_to(path).as_posix()
        if isinstance(item, Item):
            found.used[name] = item
        else:
            found.skipped[name] = item
    return found


def items_of(files: Sequence[Path], read: Read, strict: bool) -> Iterator[tuple[Path, Item | str]]:
    """Yield each file, in order, with what it became or the reason why it cannot be used.

    Raises:
        UserError: with `strict`, for the first one that cannot be used.
    """
    with _workers(read, len(files)) as results:
        for file, item in zip(files, results(files), strict=True):
            if strict and isinstance(item, str):
                raise UserError(f"{file}: {item}; fix or remove it, or leave out --strict")
            yield file, item


Results = Callable[[Sequence[Path]], Iterator["Item | str"]]


@contextmanager
def _workers(read: Read, count: int) -> Iterator[Results]:
    """Yield what reads files in order: in processes, or in threads where processes cannot be forked."""
    if count < MIN_FOR_WORKERS or cores() == 1 or multiprocessing.current_process().daemon:
        yield lambda files: (_attempt(read, file) for file in files)
    elif sys.platform == "linux":
        fork = multiprocessing.get_context("fork")
        processes = ProcessPoolExecutor(cores(), fork, _begin_worker, (read, os.getpid()))
        try:
            yield lambda files: _in_processes(processes, files)
        finally:
            processes.shutdown(cancel_futures=True)
    else:
        with ThreadPool(cores()) as threads:
            yield lambda files: threads.imap(lambda file: _attempt(read, file), files, AT_ONCE)


def _in_processes(processes: ProcessPoolExecutor, files: Sequence[Path]) -> Iterator[Item | str]:
    """Yield what files became.

    Raises:
        UserError: if a process was killed, as the system does when memory runs out.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of forking beside threads: workers use none of torch's
        found = processes.map(_attempt_here, files, chunksize=AT_ONCE)
    try:
        yield from found
    except BrokenProcessPool:
        raise UserError("a process that reads pictures was killed; free memory, or give smaller pictures") from None


def _attempt(read: Read, file: Path) -> Item | str:
    try:
        return read(file)
    except UnusablePicture as reason:
        return str(reason)


_own: list[Read] = []
"""What a worker reads pictures by; a forked process inherits it, closures included."""


def _begin_worker(read: Read, parent: int) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent
    torch.set_num_threads(1)  # the threads of the parent do not exist in a forked process
    _own[:] = [read]
    threading.Thread(target=_end_with, args=(parent,), daemon=True).start()


def _end_with(parent: int) -> None:
    """End this process when its parent is gone: one that was killed tells its workers nothing."""
    while os.getppid() == parent:
        time.sleep(0.5)
    os._exit(1)


def _attempt_here(file: Path) -> Item | str:
    return _attempt(_own[0], file)
