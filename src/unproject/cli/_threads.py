"""Threads: by default as many as there are cores that nobody else keeps busy.

Operations of small networks take microseconds, and end when their last thread does. A thread that shares its core with
another program is late by a slice of the scheduler's, milliseconds, at every one of them: on two cores, beside one busy
program, a step takes twenty times as long with two threads as with one (docs/results.md, Speed).
"""

from __future__ import annotations

import os
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from .._cores import cores as cores_given
from .._types import UserError

MOST_THREADS = 1024
"""More take the machine's memory for their stacks, and end the process."""
GIVEN_BY = ("OMP_NUM_THREADS", "MKL_NUM_THREADS")
"""Whoever sets these has chosen, as `--processes` does."""
LEAST_SECONDS = 0.2
"""Of a measurement: the system counts hundredths of a second."""
STATISTICS = Path("/proc/stat")
IDLE = slice(4, 6)
"""Words of a core's line there: how long it was idle, and how long it waited for a disk."""


@dataclass(frozen=True)
class Clocks:
    """Seconds by the clock, those that the cores open to this process were idle, and those that it computed itself.

    Among its own are those of processes that it started and that have ended, as of those that read pictures.
    """

    wall: float
    idle: float
    own: float

    @classmethod
    def now(cls) -> Clocks:
        lines = (line.split() for line in STATISTICS.read_text(encoding="ascii").splitlines())
        counts = {words[0]: sum(map(int, words[IDLE])) for words in lines if words[0].startswith("cpu")}
        idle = sum(counts.get(f"cpu{core}", 0) for core in os.sched_getaffinity(0))
        return cls(time.monotonic(), idle / os.sysconf("SC_CLK_TCK"), sum(os.times()[:4]))

    def free_cores(self, later: Clocks) -> float:
        """Return how many cores nobody else used on average from these clocks to later ones."""
        return (later.idle - self.idle + later.own - self.own) / (later.wall - self.wall)


_began: list[Clocks] = []


def begin_to_measure() -> None:
    """Read the clocks, so that `use_threads` knows what other programs do while this one is imported."""
    _began.clear()
    if sys.platform == "linux" and not _are_given():
        with suppress(OSError):  # as where /proc is not mounted
            _began.append(Clocks.now())


def use_threads(threads: int | None, before: int | None = None) -> None:
    """Let torch use this many threads.

    Args:
        threads: how many; None for one a free core, of those that this process is given, where the system tells of its
            cores and the environment does not choose, otherwise torch's own choice.
        before: how many a run had that goes on, which then has as many again, but for cores that are not there: sums
            of other threads differ in their last digits, and some ten steps later in the first.

    Raises:
        UserError: for less than one thread, or more than `MOST_THREADS`.
    """
    import torch

    if threads is not None:
        if not 1 <= threads <= MOST_THREADS:
            raise UserError(f"--threads {threads}: give 1 to {MOST_THREADS}")
        torch.set_num_threads(threads)
        return
    if _are_given():
        return
    cores = min(torch.get_num_threads(), cores_given())
    free = min(max(_free_cores(cores), 1), cores)
    torch.set_num_threads(free if before is None else min(before, cores))
    _say(torch.get_num_threads(), free, cores)


def _are_given() -> bool:
    return any(name in os.environ for name in GIVEN_BY)


def _free_cores(cores: int) -> int:
    """Return how many cores nobody else uses, to the nearest whole; all of them where that cannot be told."""
    if not _began:
        return cores
    time.sleep(max(LEAST_SECONDS - (time.monotonic() - _began[0].wall), 0.0))
    return round(_began[0].free_cores(Clocks.now()))


def _say(used: int, free: int, cores: int) -> None:
    """Say if other programs keep cores busy, or if a run that goes on has other threads than there are free cores."""
    from ._machine import leads

    if not leads() or used == free == cores:
        return
    busy = f"{cores - free} of {cores} cores are kept busy by other programs; " if free < cores else ""
    again = "" if used == free else f" as before, and {free} would give other numbers"
    print(f"{busy}computing with {used} thread{'s'[: used != 1]}{again} (--threads changes that)", file=sys.stderr)
