"""Choosing among tries: each ends at its part of the budget, and the one with the largest merit goes on."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import torch
from torch import Tensor

from .health import Diverged, not_finite
from .state import State


def choose(
    state: State, progress: float, synchronise: Callable[[Iterable[Tensor]], None], record: Callable[..., None]
) -> bool:
    """End a try that is over: keep it if it is the best so far; begin the next, or after the last return to the best.

    One that broke down is never kept: nothing would be better than a merit that is no number.

    Args:
        state: of the run; its recipe says what tries there are.
        progress: the part of the budget that is spent.
        synchronise: overwrites tensors by those of the first process.
        record: writes a line to the log.

    Returns:
        Whether the state has other networks now.

    Raises:
        Diverged: if all tries broke down.
    """
    tries, counters = state.recipe.tries, state.counters
    if tries is None or counters.tried >= tries.count or progress < tries.end(counters.tried):
        return False
    if counters.tried == 0 and (tries.count == 1 or counters.step < tries.least_steps):
        counters.tried = tries.count
        return False
    merit = merit_of(state, synchronise)
    sound = math.isfinite(merit)
    record(event="tried", number=counters.tried, merit=round(merit, 4) if sound else None)
    if sound and (not state.kept or merit > counters.best_merit):
        state.keep(merit)
    if counters.tried + 1 == tries.count and not state.kept:
        raise Diverged(f"training broke down in all {tries.count} tries; lower the learning rate")
    counters.tried, counters.began, counters.collapsed = counters.tried + 1, counters.step, 0
    if counters.tried < tries.count:
        state.begin_again(counters.tried, progress)
    else:
        state.take_kept(progress)
    return True


def merit_of(state: State, synchronise: Callable[[Iterable[Tensor]], None]) -> float:
    """Return the merit of the present try, the same in all processes; -inf if a number of it is not finite."""
    merit = torch.tensor(float(sum(panel.assignment.merit() for panel in state.panels)))
    if not merit.isfinite() or not_finite(state.tensors()):
        merit.fill_(-math.inf)
    synchronise([merit])
    return merit.item()
