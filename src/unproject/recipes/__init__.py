"""Recipes: plain functions that return a `Recipe`. There is no registry: a third party passes `module:function`."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._objects import find_object, nearest
from .._types import UserError

if TYPE_CHECKING:
    from ..training.recipe import Recipe
    from ..training.run_directory import Origin

_HOME = {
    "shapes": ("unproject.recipes.shapes:shapes", "shapes from silhouettes, made for a laptop"),
    "shapes-paper": ("unproject.recipes.shapes:shapes_paper", "shapes from silhouettes, the paper's choices"),
    "digits": ("unproject.recipes.digits:digits", "images from line integrals, made for a laptop"),
    "wood": ("unproject.recipes.materials:wood_materials", "wood from maps and photographs, made for a laptop"),
    "metal": ("unproject.recipes.materials:metal_materials", "metal from maps and photographs, made for a laptop"),
    "plastic": ("unproject.recipes.materials:plastic_materials", "plastic from maps and photographs, for a laptop"),
    "correlated": (
        "unproject.recipes.materials:correlated_materials",
        "materials whose maps are correlated by design, or not: a test of what is learned",
    ),
    "wood-paper": ("unproject.recipes.materials:wood_paper", "wood from maps and photographs, the paper's choices"),
    "metal-paper": ("unproject.recipes.materials:metal_paper", "metal from maps and photographs, the paper's choices"),
    "plastic-paper": ("unproject.recipes.materials:plastic_paper", "plastic, likewise, the paper's choices"),
    "digits-paper": ("unproject.recipes.digits:digits_paper", "images from line integrals, the paper's choices"),
}


def names() -> dict[str, str]:
    """The recipes that come with the package: name → one line."""
    return {name: line for name, (_, line) in _HOME.items()}


def find(name: str) -> Callable[..., Recipe]:
    """The function of a built-in recipe. Raises UserError for an unknown name."""
    if name not in _HOME:
        raise UserError(f"there is no recipe {name!r}{nearest(name, _HOME)}; `unproject recipes` lists them")
    module, _, function = _HOME[name][0].partition(":")
    return getattr(import_module(module), function)


def origin(name: str, arguments: dict[str, Any]) -> Origin:
    """What recipe.json remembers of a call: paths become absolute, so that a run resumes from any folder."""
    from ..training.run_directory import Origin

    source, colon, function = name.rpartition(":")
    if source.endswith(".py"):
        name = f"{Path(source).absolute()}{colon}{function}"
    stored = {k: {"path": str(v.absolute())} if isinstance(v, Path) else v for k, v in arguments.items()}
    return Origin(name, stored)


def rebuild(remembered: Origin, trust: bool = False, **changes: Any) -> Recipe:
    """Call the recipe function of a run again, with some arguments changed.

    Raises:
        UserError: if the run was started from Python without a recipe function, or the function is not of this
            package and `trust` is not given: importing it would run its code.
    """
    if not remembered.recipe:
        raise UserError("this run was started from Python; call unproject.resume(recipe, path) from there")
    if ":" in remembered.recipe and not trust:
        raise UserError(
            f"this run's recipe is {remembered.recipe}, code outside unproject; add --trust if you wrote it"
        )
    function = find_object(remembered.recipe) if ":" in remembered.recipe else find(remembered.recipe)
    arguments = {**{k: _restored(v) for k, v in remembered.arguments.items()}, **changes}
    unknown = set(arguments) - set(inspect.signature(function).parameters)
    if unknown:
        raise UserError(
            f"recipe {remembered.recipe} no longer takes {', '.join(sorted(unknown))}; use the version that began it"
        )
    return function(**arguments)


def _restored(value: Any) -> Any:
    if isinstance(value, dict) and set(value) == {"path"} and isinstance(value["path"], str):
        return Path(value["path"])
    return tuple(value) if isinstance(value, list) else value
