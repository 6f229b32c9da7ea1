"""Maps of materials from what is named on the command line."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Literal, NamedTuple

from .._types import UserError
from ._machine import say_skipped

if TYPE_CHECKING:
    from torch import Tensor


class Materials(NamedTuple):
    """Maps (N, 8 or 10, H, W), how their specular albedo is meant, and (name, reason) of those that were skipped."""

    maps: Tensor
    fresnel: Literal["eta", "albedo"]
    skipped: tuple[tuple[str, str], ...] = ()

    def say_skipped(self) -> None:
        say_skipped(self.skipped, len(self.maps))


def read_maps(path: Path, size: int | None = None, coloured: bool = False) -> Materials:
    """Of an .npz or of folders of textures, with three specular channels if `coloured`."""
    from ..data import Collection, Convention, holds_textures, photographed
    from ..data.readers.arrays import load_arrays
    from ..data.readers.textures import fresnel_of

    if (path / "recipe.json").is_file():
        raise UserError(f"{path}: is a run; `unproject sample {path} --out materials.npz` makes materials of it first")
    if path.is_dir() and (lights := photographed(path)) and not holds_textures(path):
        raise UserError(
            f"{path}: holds pictures by what they show ({', '.join(lights)}), no materials; `unproject train materials "
            f"--data {path}` learns materials from them"
        )
    if coloured and path.suffix.lower() == ".npz":
        raise UserError(f"--coloured-specular: {path} has the specular map it has; it is for folders of textures")
    found = Collection.materials(path, size, convention=Convention(specular="colour") if coloured else None)
    if path.suffix.lower() != ".npz":
        return Materials(found.items, "albedo", found.skipped)
    return Materials(found.items, fresnel_of(path, load_arrays(path)))
