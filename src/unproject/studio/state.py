"""State: what the studio keeps between requests: the folder, the runs it has opened, the threads that compute."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import TimeoutError as Waited
from pathlib import Path
from typing import Any, TypeVar

from ..training import Run, load
from ..training.checkpoint import checkpoint_of, list_checkpoints, step_of
from .answers import Busy, Missing, Request
from .folder import Folder
from .worker import Worker

T = TypeVar("T")
OPENED, WAITING, JOBS = 4, 16, 3
"""Runs that are kept open, requests that may wait, and fits that may wait."""
LONGEST = 120.0
"""Seconds that a request waits for its answer."""


class State:
    """What lasts as long as the studio.

    Args:
        folder: where runs lie.
        trust: import code of runs outside this package.

    Attributes:
        worker: computes what is answered at once.
        jobs: computes what takes long.
        writing: held while a file of a run is changed.
    """

    def __init__(self, folder: Path, trust: bool = False) -> None:
        self.folder, self.trust = Folder(folder), trust
        self.worker, self.jobs = Worker(WAITING), Worker(JOBS)
        self._kept: OrderedDict[tuple[Any, ...], Any] = OrderedDict()
        self._lock = threading.Lock()
        self.writing = threading.Lock()

    @property
    def computes(self) -> bool:
        """Whether a thread computes at this moment."""
        return self.worker.busy or self.jobs.busy

    def compute(self, call: Callable[[], T]) -> T:
        """Return what a call returns, made in the thread that computes.

        Raises:
            Busy: if it takes too long; it is then left, unless it is being computed already.
        """
        future = self.worker.submit(call)
        try:
            return future.result(LONGEST)
        except Waited:
            if future.done():  # the call itself ran into something of that name
                raise
            future.cancel()
            raise Busy("this takes long and is still being computed; look again in a minute") from None

    def shown(self, request: Request) -> Run:
        """Return the run that an address names, at the step that it names, if it names one."""
        step = request.whole("step", 0, 0, 2**53) if request.text("step", "") else None
        return self.opened(request.text("run"), step)

    def kept(self, key: tuple[Any, ...], make: Callable[[], T], most: int = 256) -> T:
        """Return what was made for a key before, or make it; of keys that begin alike only the `most` newest stay."""
        with self._lock:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
        made = make()
        with self._lock:
            self._kept[key] = made
            alike = [other for other in self._kept if other[0] == key[0]]
            for old in alike[: max(len(alike) - most, 0)]:
                del self._kept[old]
        return made

    def opened(self, name: str, step: int | None = None) -> Run:
        """Return a run as its newest checkpoint has it, or as that of a step had it that is open still.

        Raises:
            Missing: if that step's weights are no longer there.
        """
        path = self.folder.run(name)
        newest = next(reversed(list_checkpoints(path / "checkpoints")), None)
        wanted = checkpoint_of(path, step).name if step is not None else newest.name if newest else ""
        key, stored = ("run", name, wanted), None
        if newest is not None and wanted == newest.name:
            stored = newest.stat().st_mtime_ns  # the run may have been made again
            with self._lock:
                if key in self._kept and self._kept[key][0] != stored:
                    del self._kept[key]

        def read() -> tuple[int | None, Run]:
            if stored is None and newest is not None:
                raise Missing(f"{name}: its weights of step {step:,} are no longer there; show the newest")
            return stored, load(path, trust=self.trust, step=step_of(newest) if newest else None)  # not a newer one

        return self.kept(key, read, OPENED)[1]

    def version(self, run: Run) -> tuple[int, int]:
        """Return what tells the weights of a run from others of its name: their step, and when they were written."""
        try:
            return run.step, checkpoint_of(run.path / "checkpoints", run.step).stat().st_mtime_ns
        except FileNotFoundError:  # the training has gone on since
            return run.step, 0
