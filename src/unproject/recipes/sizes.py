"""Sizes: the resolution that recipes of shapes learn at, chosen by the data."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec

from ..data import side_of
from ..training import Recipe

P = ParamSpec("P")
SMALL, LARGE = 32, 64
STEPS = {SMALL: 4000, LARGE: 3000}
"""The budget of each; at 64³ it takes about half an hour on two cores."""


def size_for(data: Path | None) -> int:
    """Return 64 if the pictures or volumes of `data` have at least 64 pixels a side, else 32."""
    side = None if data is None else side_of(data)
    return SMALL if side is None or side < LARGE else LARGE


def sized_by_data(function: Callable[P, Recipe]) -> Callable[P, Recipe]:
    """Give a recipe function the `size` that its `data` are for, unless one is given.

    It goes around `resumable`, so that recipe.json holds the size: a run resumes at it whatever becomes of the data.
    Direct training stays at 32³: at 64³ a step of 3-D convolutions takes seven seconds of a core.
    """

    @functools.wraps(function)
    def sized(*positional: P.args, **arguments: P.kwargs) -> Recipe:
        if arguments.get("size") is None:
            data = arguments.get("data")
            chosen = (
                SMALL if arguments.get("views") == "direct" else size_for(data if data is None else Path(str(data)))
            )
            arguments["size"] = chosen
        return function(*positional, **arguments)

    return sized
