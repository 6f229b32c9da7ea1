"""Maps of materials from what is named on the command line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from .._types import UserError

if TYPE_CHECKING:
    from torch import Tensor


def read_maps(path: Path, size: int | None = None) -> tuple[Tensor, Literal["eta", "albedo"]]:
    """(N, 8, H, W) of an .npz or of folders of textures, and how their specular albedo is meant."""
    import numpy as np

    from ..data import material_records

    found = material_records(path, size)
    for name, why in found.skipped:
        print(f"skipped {name}: {why}", file=sys.stderr)
    if path.suffix != ".npz":
        return found.items, "albedo"
    with np.load(path, allow_pickle=False) as arrays:
        meant = str(arrays["fresnel"]) if "fresnel" in arrays else "eta"
    if meant not in ("eta", "albedo"):
        raise UserError(f"{path}: fresnel is {meant!r}; store 'eta' or 'albedo', or leave it out")
    return found.items, meant
