"""Budget: the steps or minutes of a run on disk, and how much of them is spent."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from .._files import read_json
from .counters import Counters
from .recipe import Recipe, part_spent
from .run_directory import BUDGET, RESTORE, write_json


def progress_of(resolved: Mapping[str, Any], step: int, seconds: float) -> float:
    """Return the part of the budget of recipe.json that is spent (`Recipe.progress`), whatever else stands there."""
    steps, minutes = (_positive(resolved.get(name)) for name in BUDGET)
    return part_spent(steps, minutes, step, seconds)


def stored_of(recipe: Recipe, counters: Counters) -> tuple[int, bool]:
    """Return what a checkpoint with these counters says: its step, and whether the budget is spent.

    A step that was stored before the minutes were over is stored again after, or the run would load as unfinished.
    """
    return counters.step, recipe.progress(counters.step, counters.seconds) >= 1


def has_budget(path: Path, recipe: Recipe) -> bool:
    """Whether the budget of a run on disk is that of the recipe."""
    stored = read_json(path / "recipe.json", RESTORE)["resolved"]
    return all(stored.get(name) == getattr(recipe, name) for name in BUDGET)


def store_budget(path: Path, recipe: Recipe) -> None:
    """Write the budget of a run that goes on to its recipe.json."""
    if has_budget(path, recipe):
        return
    file = path / "recipe.json"
    content, budget = read_json(file, RESTORE), {name: getattr(recipe, name) for name in BUDGET}
    content["resolved"] |= budget
    if content.get("function"):  # by which it is built again
        given = {name: value for name, value in budget.items() if value is not None}
        content["arguments"] = {k: v for k, v in content["arguments"].items() if k not in BUDGET} | given
    write_json(file, content)


def _positive(value: object) -> float:
    return max(number(value) or 0.0, 0.0)


def number(value: Any) -> float | None:
    """Return a finite number of a file as a float, and None of anything else."""
    fits = isinstance(value, (int, float)) and not isinstance(value, bool)
    try:
        return float(value) if fits and math.isfinite(value) else None
    except OverflowError:  # an integer of hundreds of digits
        return None
