"""State: what the studio keeps between requests: the folder, the runs it has opened, the threads that compute."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from ..training import Run, load
from .answers import Missing, Request
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

    def compute(self, call: Callable[[], T]) -> T:
        """Return what a call returns, made in the thread that computes."""
        return self.worker.submit(call).result(LONGEST)

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
        newest = max((file.name for file in (path / "checkpoints").glob("step-*.safetensors")), default="")
        wanted = newest if step is None else f"step-{step:09d}.safetensors"

        def read() -> Run:
            if wanted != newest:
                raise Missing(f"{name}: its weights of step {step:,} are no longer there; show the newest")
            return load(path, trust=self.trust)

        return self.kept(("run", name, wanted), read, OPENED)
