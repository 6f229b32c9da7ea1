"""Choosing among tries: each ends at its part of the budget, and the one with the largest merit goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import torch
from torch import Tensor

from .state import State


def choose(
    state: State, progress: float, synchronise: Callable[[Iterable[Tensor]], None], record: Callable[..., None]
) -> bool:
    """End a try that is over: keep it if it is the best so far; begin the next, or after the last return to the best.

    Args:
        state: of the run; its recipe says what tries there are.
        progress: the part of the budget that is spent.
        synchronise: overwrites tensors by those of the first process.
        record: writes a line to the log.

    Returns:
        Whether the state has other networks now.
    """
    tries, counters = state.recipe.tries, state.counters
    if tries is None or counters.tried >= tries.count or progress < tries.end(counters.tried):
        return False
    if counters.tried == 0 and (tries.count == 1 or counters.step < tries.least_steps):
        counters.tried = tries.count
        return False
    merit = torch.tensor(sum(panel.assignment.merit() for panel in state.panels))
    synchronise([merit])
    record(event="tried", number=counters.tried, merit=round(merit.item(), 4))
    if counters.tried == 0 or merit.item() > counters.best_merit:
        state.keep(merit.item())
    counters.tried, counters.began, counters.collapsed = counters.tried + 1, counters.step, 0
    if counters.tried < tries.count:
        state.begin_again(counters.tried, progress)
    else:
        state.take_kept(progress)
    return True
