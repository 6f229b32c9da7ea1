"""Pace: tells when steps have come to take much longer, as when another program keeps cores busy.

Threads that share their cores with another program wait for one another at every operation (docs/results.md, Speed).
How many there are stays as it is: sums of other numbers of threads differ in their last digits, and a run that is
killed and resumed has to give the numbers of one that is not.
"""

from __future__ import annotations

import math
from statistics import median

WINDOW, TIMES = 10, 4.0
"""Steps whose median counts, and how many times as long as in the fastest such window they have to take."""
SLOWER = (
    "steps take {:.0f} times as long as they did: other programs keep cores busy, and threads wait for one another; "
    "stop it (Ctrl-C) and resume it with --threads 1, which changes the last digits"
)


class Pace:
    """Compares the seconds of steps with those of the fastest before, in this process.

    Examples:
        >>> pace = Pace()
        >>> told = [pace.add(seconds) for seconds in 30 * [0.5] + 30 * [4.0]]
        >>> [(step, times) for step, times in enumerate(told) if times]
        [(49, 8.0)]
    """

    def __init__(self) -> None:
        self._seconds: list[float] = []
        self._fastest, self._is_slow, self._told = math.inf, False, False

    def add(self, seconds: float) -> float | None:
        """Count a step; return how many times as long steps take now, once, if two windows in a row are that slow."""
        self._seconds.append(seconds)
        if len(self._seconds) < WINDOW:
            return None
        found, was_slow = median(self._seconds), self._is_slow
        self._seconds.clear()
        self._fastest = min(self._fastest, found)
        self._is_slow = found > TIMES * self._fastest
        if not (self._is_slow and was_slow) or self._told:
            return None
        self._told = True
        return found / self._fastest
