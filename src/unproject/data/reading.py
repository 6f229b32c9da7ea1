"""Read: whatever a path holds as a collection."""

from __future__ import annotations

from typing import Literal

from .collection import Collection, PathLike
from .readers.framing import Framing
from .readers.options import ReadOptions
from .readers.paths import find


def read(
    path: PathLike,
    size: int | None = None,
    *,
    pictures: Literal["silhouettes", "images"] = "silhouettes",
    framing: Framing | None = None,
    strict: bool = False,
) -> Collection:
    """Read what a path holds: pictures, volumes or line integrals.

    Args:
        path: a folder of pictures, an .npz, .npy or idx file, or a 3-D collection.
        size: pixels or voxels a side; default: 64 for a folder of silhouettes, 32 for meshes, else as stored.
        pictures: read pictures as `Collection.silhouettes` or as `Collection.images` does.
        framing: of silhouettes.
        strict: fail on the first file that cannot be used instead of skipping it.

    Raises:
        UserError: if there is nothing there that can be used.
    """
    options = ReadOptions(size, images=pictures == "images", framing=framing, strict=strict)
    return Collection(**find(path, options)._asdict())
