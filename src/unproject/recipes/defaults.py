"""Defaults that are chosen by the data or the machine, and written down as if they had been given."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from ..training import Recipe

Function: TypeAlias = Callable[..., Recipe]


def with_default(name: str, choose: Callable[[Mapping[str, Any]], Any]) -> Callable[[Function], Function]:
    """Give a recipe function an argument that is chosen by the others, unless it is given or None is chosen.

    It goes around `resumable`, so that recipe.json holds what was chosen: a run keeps it on another machine, whatever
    becomes of its data, and whatever later versions choose.
    """

    def decorate(function: Function) -> Function:
        @functools.wraps(function)
        def made(*positional: Any, **arguments: Any) -> Recipe:
            chosen = choose(arguments) if arguments.get(name) is None else None
            return function(*positional, **(arguments if chosen is None else {**arguments, name: chosen}))

        return made

    return decorate
