"""Sizes: the resolution that recipes of shapes learn at, chosen by the data."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec

from ..data import picture_count, side_of
from ..training import Recipe

P = ParamSpec("P")
SMALL, LARGE = 32, 64
LEAST_MINUTES = 30.0
"""Shorter budgets are spent at 32³: a step at 64³ takes four times as long, and views must be found first."""

FEW = 1000
"""Pictures of a folder below which shapes stay at 32³: of 297 birds and 100 chairs nothing came at 64³ in half an hour,
where the discriminators learn the few by heart."""


def steps_of(size: int | None) -> int:
    """Return the budget of runs of this size: at 64³ about half an hour on two cores."""
    return 3000 if size is not None and size >= LARGE else 4000


def size_for(data: Path | None) -> int:
    """Return 64 if the pictures or volumes of `data` are at least 64 a side, and no folder of few, else 32."""
    side = None if data is None else side_of(data)
    if data is None or side is None or side < LARGE:
        return SMALL
    count = picture_count(data)
    return SMALL if count is not None and count < FEW else LARGE


def sized_by_data(function: Callable[P, Recipe]) -> Callable[P, Recipe]:
    """Give a recipe function the `size` that its `data` are for, unless one is given.

    It goes around `resumable`, so that recipe.json holds the size: a run resumes at it whatever becomes of the data.
    Short budgets stay at 32³, and so does direct training: at 64³ a step of 3-D convolutions takes seven seconds of a
    core.
    """

    @functools.wraps(function)
    def sized(*positional: P.args, **arguments: P.kwargs) -> Recipe:
        if arguments.get("size") is None:
            data, minutes = arguments.get("data"), arguments.get("minutes")
            short = isinstance(minutes, int | float) and minutes < LEAST_MINUTES
            small = short or arguments.get("views") == "direct"
            arguments["size"] = SMALL if small else size_for(data if data is None else Path(str(data)))
        return function(*positional, **arguments)

    return sized
