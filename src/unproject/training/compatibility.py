"""Compatibility: whether a recipe, and its data, are those that a run was started with."""

from __future__ import annotations

import json
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from .._objects import module_name
from .._types import UserError
from ..assignment import Panel
from .description import describe, matches
from .recipe import Recipe
from .run_directory import BUDGET, read_recipe

HARMLESS = (*BUDGET, "checkpoint_every", "coarse")
"""Fields that may differ between a run and its continuation."""


def check_same(path: Path, recipe: Recipe) -> None:
    """Raise UserError, naming the field, unless `recipe` is the one the run was started with (budget aside)."""
    before, now = _as_described_now(read_recipe(path)["resolved"]), json.loads(json.dumps(describe(recipe)))
    for name in before | now:
        if name not in HARMLESS and not matches(before.get(name), now.get(name)):
            why = _which_data_differ(before.get(name), recipe.panels) if name == "panels" else ""
            why = why or f"{name} differs from when the run was started; resume with the same recipe and data"
            raise UserError(
                f"{path}: {why}, or begin a new run, with the weights of this one by train --from "
                "(unproject.train(recipe, out, start=path))"
            )


def _which_data_differ(before: Any, panels: Sequence[Panel]) -> str:
    """Say of which panel, of those described before, the data differ, and what to do; "" if none do."""
    for then, panel in zip(before if isinstance(before, list) else (), panels, strict=False):
        described = describe(panel)
        old, new = ([*_collections(each), *_collections({"data": each.get("held_out")})] for each in (then, described))
        if not matches(old, new):
            counts = [sum(each["collection"][0] for each in found) for found in (old, new)]
            numbers = f": {counts[0]} items then, {counts[1]} now" if counts[0] != counts[1] else ""
            source = panel.collections[0].source
            return f"the data differ from those that the run was started with ({source}{numbers}); restore them"
    return ""


def _as_described_now(resolved: dict[str, Any]) -> dict[str, Any]:
    """Return the description of a run of before 28 November 2026 as it would be now.

    What a script defined was named as it was called in its own process; and discriminators had the batch as `group`.
    """
    found = json.loads(json.dumps(resolved).replace('"__main__:', f'"{module_name("__main__")}:'))
    with suppress(AttributeError, KeyError, TypeError):
        arguments = found["discriminator"]["arguments"]
        if arguments.get("group") == found["batch"]:
            del arguments["group"]
    return found


def check_data(path: Path, recipe: Recipe) -> None:
    """Warn if a recipe has other data than the run was started with, of the same number and shape.

    Raises:
        UserError: if their numbers or shapes differ.
    """
    before = _collections(read_recipe(path)["resolved"].get("panels"))
    now = [found for panel in recipe.panels for found in _collections(describe({"data": panel.data}))]
    if [found["collection"] for found in before] != [found["collection"] for found in now]:
        counts = [", ".join(str(each["collection"][0]) for each in found) for found in (before, now)]
        raise UserError(f"{path}: was trained on other data ({counts[0]} items then, {counts[1]} now); restore them")
    if not matches(before, now):
        warnings.warn(f"{path}: its data are others than in training; pictures are compared with them", stacklevel=2)


def _collections(described: Any) -> list[dict[str, Any]]:
    """Return what describes the data of described panels."""
    if isinstance(described, list):
        return [found for part in described for found in _collections(part)]
    if not isinstance(described, dict):
        return []
    shape = described.get("collection")
    return [described] if isinstance(shape, list) and shape else _collections(described.get("data"))
