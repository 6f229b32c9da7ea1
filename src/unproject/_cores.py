"""Cores: how many of the machine's processors this process may use."""

from __future__ import annotations

import math
import os
from contextlib import suppress
from pathlib import Path

GROUPS, OWN = Path("/sys/fs/cgroup"), Path("/proc/self/cgroup")
"""Where Linux shows control groups, and says which ones a process is in."""


def cores() -> int:
    """Return how many cores this process may use: those that are open to it, and no more than its control groups give.

    A container that is given two of 64 cores (`docker run --cpus 2`) sees all 64. With as many threads it is stopped
    for most of the time.
    """
    open_to = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(int(min(open_to, quota())), 1)


def quota() -> float:
    """Return of how many cores the control groups of this process give it the time; inf if nothing limits it."""
    found = [math.inf]
    with suppress(OSError, ValueError):  # another system, or one that is not as its documentation says
        for line in OWN.read_text(encoding="utf-8").splitlines():
            _, controllers, path = line.split(":", 2)
            if not controllers or "cpu" in controllers.split(","):  # version 2, or 1
                top = GROUPS / "cpu" if controllers else GROUPS
                group = top / path.lstrip("/")
                # A container may see its own group as the topmost one, whatever its path is outside.
                found += [_quota_of(one) for one in (group, *group.parents) if one.is_relative_to(top)]
    return min(found)


def _quota_of(group: Path) -> float:
    """Return the quota over the period, both in microseconds, that a group of either version states."""
    with suppress(OSError, ValueError, ZeroDivisionError):
        given, period = (group / "cpu.max").read_text(encoding="ascii").split()
        return int(given) / int(period)  # "max" is no number
    with suppress(OSError, ValueError, ZeroDivisionError):
        given, period = ((group / f"cpu.cfs_{name}_us").read_text(encoding="ascii") for name in ("quota", "period"))
        return int(given) / int(period) if int(given) > 0 else math.inf
    return math.inf
