"""Maps of materials from what is named on the command line."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from .._types import UserError

if TYPE_CHECKING:
    from torch import Tensor


class Materials(NamedTuple):
    """Maps (N, 8, H, W), how their specular albedo is meant, and (name, reason) of those that were skipped."""

    maps: Tensor
    fresnel: Literal["eta", "albedo"]
    skipped: tuple[tuple[str, str], ...] = ()

    def say_skipped(self) -> None:
        """To be said when all went well: of a mistake there is one line and no more."""
        for name, why in self.skipped:
            print(f"skipped {name}: {why}", file=sys.stderr)
        if self.skipped:
            print(f"skipped {len(self.skipped)} of {len(self.skipped) + len(self.maps)} materials", file=sys.stderr)


def read_maps(path: Path, size: int | None = None) -> Materials:
    """Of an .npz or of folders of textures."""
    import numpy as np

    from ..data import Collection

    found = Collection.materials(path, size)
    if path.suffix.lower() != ".npz":
        return Materials(found.items, "albedo", found.skipped)
    with np.load(path, allow_pickle=False) as arrays:
        meant = str(arrays["fresnel"]) if "fresnel" in arrays else "eta"
    if meant not in ("eta", "albedo"):
        raise UserError(f"{path}: fresnel is {meant!r}; store 'eta' or 'albedo', or leave it out")
    return Materials(found.items, meant)
