"""Recipes: plain functions that return a `Recipe`. There is no registry: a third party passes `module:function`."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import TYPE_CHECKING

from .._objects import nearest
from .._types import UserError

if TYPE_CHECKING:
    from ..training import Recipe

_HOME = {
    "shapes": ("unproject.recipes.shapes:shapes", "shapes from silhouettes, for a laptop"),
    "shapes-paper": ("unproject.recipes.shapes:shapes_paper", "shapes from silhouettes, the paper's choices"),
    "digits": ("unproject.recipes.digits:digits", "images from line integrals, for a laptop"),
    "materials": (
        "unproject.recipes.materials:surface_materials",
        "materials of any kind from maps and photographs, for a laptop; without --data of wood",
    ),
    "wood": ("unproject.recipes.materials:wood_materials", "wood from maps and photographs, for a laptop"),
    "metal": ("unproject.recipes.materials:metal_materials", "metal from maps and photographs, for a laptop"),
    "plastic": ("unproject.recipes.materials:plastic_materials", "plastic from maps and photographs, for a laptop"),
    "fabric": ("unproject.recipes.materials:fabric_materials", "fabric from maps and photographs, for a laptop"),
    "correlated": (
        "unproject.recipes.materials:correlated_materials",
        "materials some of whose maps are correlated by design: a test",
    ),
    "wood-paper": ("unproject.recipes.materials:wood_paper", "wood from maps and photographs, the paper's choices"),
    "metal-paper": ("unproject.recipes.materials:metal_paper", "metal from maps and photographs, the paper's choices"),
    "plastic-paper": ("unproject.recipes.materials:plastic_paper", "plastic, likewise, the paper's choices"),
    "digits-paper": ("unproject.recipes.digits:digits_paper", "images from line integrals, the paper's choices"),
}


def names() -> dict[str, str]:
    """Return the recipes that come with the package: name → one line."""
    return {name: line for name, (_, line) in _HOME.items()}


def name_of(function: str) -> str | None:
    """Return the name of a built-in recipe by its function, "module:function"; None for any other.

    Examples:
        >>> name_of("unproject.recipes.shapes:shapes")
        'shapes'
    """
    return next((name for name, (home, _) in _HOME.items() if home == function), None)


def find(name: str) -> Callable[..., Recipe]:
    """Return the function of a built-in recipe. Raises UserError for an unknown name."""
    if name not in _HOME:
        any_kind = "shapes, digits and materials learn from data of any kind"
        raise UserError(f"there is no recipe {name!r}{nearest(name, _HOME)}; {any_kind}; `unproject recipes` lists all")
    module, _, function = _HOME[name][0].partition(":")
    return getattr(import_module(module), function)
