"""Collection: what one way of looking is learned from.

Collection("masks/")             a folder of pictures, framed as `framing.py` says
Collection("masks.npz")          arrays, as they are unless a framing is given; also .npy and idx files
Collection("scans.npz")          line integrals, an array (N, D) named `lines`
Collection("chairs.npz:chair")   volumes: .npz of voxels, .binvox, meshes, or a folder of them
Collection(tensor)               items in memory
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import torch.nn.functional as F
from torch import Tensor

from .._types import UserError
from .readers.arrays import read_arrays
from .readers.framing import Framing
from .readers.pictures import SUFFIXES as PICTURES
from .readers.pictures import read_folder
from .readers.shapes import SUFFIXES as SHAPES
from .readers.shapes import is_shape_archive, split_selector
from .readers.shapes import read_shapes as _read_shapes
from .records import Records


class Collection(Records):
    """Items with their names and known latents, from a path or from memory.

    Args:
        source: a path, a tensor or an array (N, ...), or other records.
        size: side of the pictures or volumes; else 64 for folders of pictures, 32 for meshes, as stored for arrays.
        framing: how pictures are framed; else cropped and centred for folders, as they are for arrays.
        strict: fail on the first file that cannot be used instead of skipping it.

    Raises:
        UserError: if the source cannot be used; the message says how to mend it.
    """

    def __init__(
        self, source: Any, *, size: int | None = None, framing: Framing | None = None, strict: bool = False
    ) -> None:
        if isinstance(source, (str, os.PathLike)):
            found = find_records(Path(source), size, framing, strict)
        else:
            found = source if isinstance(source, Records) else Records.from_tensor(source)
        super().__init__(found.items, found.names, found.latents, found.skipped, found.source)


def read(
    path: str | os.PathLike[str], *, size: int | None = None, framing: Framing | None = None, strict: bool = False
) -> Collection:
    """The collection at a path, whatever its kind: see `Collection`."""
    return Collection(path, size=size, framing=framing, strict=strict)


def read_images(path: str | os.PathLike[str], size: int) -> Collection:
    """Pictures (N, 1, size, size), or the line integrals (N, 1, D) that a file holds as `lines`.

    Smaller pictures get a dark margin all around, as MNIST's 28² do; larger ones are resampled.

    Raises:
        UserError: as `read`, and for pictures of several channels or volumes.
    """
    found = read(path)
    if found.items.dim() == 3 and found.items.shape[1] == 1:
        return found
    if found.items.dim() != 4 or found.items.shape[1] != 1:
        raise UserError(f"{path}: holds no pictures of one channel, but items of shape {tuple(found.items.shape[1:])}")
    if max(found.items.shape[2:]) > size:
        found = read(path, size=size)
    return Collection.from_tensor(padded(found.items, size), found.latents, found.names, found.skipped, found.source)


def padded(images: Tensor, size: int) -> Tensor:
    """Images in the middle of size² zeros."""
    height, width = (size - side for side in images.shape[2:])
    return F.pad(images, (width // 2, width - width // 2, height // 2, height - height // 2))


def read_shapes(path: str | os.PathLike[str], resolution: int = 32, **options: Any) -> Collection:
    """The volumes (N, R, R, R) of a 3-D collection; `shapes.read_shapes` has the options."""
    return Collection(_read_shapes(Path(path), resolution, **options))


def find_records(path: Path, size: int | None, framing: Framing | None, strict: bool) -> Records:
    """Send a path to the reader of its kind.

    Raises:
        UserError: if nothing is there, or no reader knows it.
    """
    check_size(path, size)
    file, selector = split_selector(path)
    if path.is_dir():
        return _of_folder(path, size, framing, strict)
    if not file.exists():
        raise UserError(f"{path}: there is no such file or folder; check the path")
    if selector or file.suffix.lower() in SHAPES or is_shape_archive(file):
        return _read_shapes(path, size, strict=strict)
    if file.suffix.lower() in PICTURES:
        raise UserError(f"{path}: is one picture; name the folder it lies in")
    return read_arrays(file, size, framing, strict)


def check_size(path: Path, size: int | None) -> None:
    """Refuse sizes nothing can be seen at, and those that fill the memory with one item."""
    if size is not None and not 4 <= size <= 4096:
        raise UserError(f"{path}: a size of {size} makes no sense; give 4 to 4096")


def _of_folder(path: Path, size: int | None, framing: Framing | None, strict: bool) -> Records:
    """Pictures unless there are only shapes."""
    if holds_only_shapes(path):
        return _read_shapes(path, size, strict=strict)
    return read_folder(path, size, framing, strict)


def holds_only_shapes(path: Path) -> bool:
    """Whether a folder has files of shapes and no picture."""
    found = {file.suffix.lower() for file in path.rglob("*") if not file.name.startswith(".")}
    return bool(found & set(SHAPES)) and not found & set(PICTURES)
