"""Held-out samples of the data sets that recipes use when no data are given; no recipe trains on them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from torch import Tensor

from ..data import chairs, digits, material_patches
from ..domains import Domain
from ..training import Origin
from . import name_of
from .material_panels import are_photographs, textures_of
from .materials import PROCEDURAL

UNSEEN = 2**40
"""The seed of materials that no recipe trains on."""
CHAIRS = 200

HELD_OUT: dict[str, Callable[..., Tensor]] = {
    "shapes": lambda size, count: chairs(CHAIRS, size, seed=1),
    "digits": lambda size, count: digits(size, held_out=True),
    **{
        name: lambda size, count, make=make, **how: make(count, size, UNSEEN, **how)
        for name, make in PROCEDURAL.items()
    },
}
"""Recipe, without `-paper` → (side, how many at most, of materials `coloured`) → held-out samples."""


def patches_of(domain: Domain, origin: Origin | None, path: Path, size: int, count: int) -> Tensor | None:
    """Return patches of textures, if a run was trained on such patches; None if samples are compared as they are.

    Whole textures have other details at this size, and a perfect generator would seem far from them.
    """
    data = None if origin is None else origin.arguments.get("data")
    data = data.get("path") if isinstance(data, dict) else data
    if domain.name != "maps" or data is None or are_photographs(Path(data)):
        return None
    found = textures_of(path, size, coloured=True)
    return None if found.shape[-2:] == (size, size) else material_patches(found, count, size, UNSEEN)


def held_out(origin: Origin | None, size: int, count: int) -> Tensor | None:
    """Return held-out samples for a run of a built-in recipe on its own data set; None for any other run."""
    if origin is None or origin.arguments.get("data") is not None:
        return None
    make = HELD_OUT.get((name_of(origin.function) or origin.recipe).removesuffix("-paper"))
    how = {"coloured": True} if origin.arguments.get("coloured_specular") else {}
    return None if make is None else make(size, count, **how)
