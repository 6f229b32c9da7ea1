"""MagicaVoxel's .vox: the chunks SIZE, XYZI and RGBA of version 150.

MagicaVoxel has x to the right, y away from the viewer and z up, so voxel (x, y, z) of ours is its (x, -z, y).
Source: ephtracy/voxel-model, MagicaVoxel-file-format-vox.txt.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from unproject._types import UserError
from unproject.export._volumes import Written, as_batch, is_file, keep_usable, names_for, save, warn_left

_LARGEST = 256
_CLAY = (206, 174, 152)


def vox(
    volumes: ArrayLike, path: str | PathLike[str], *, names: Sequence[str] | None = None, level: float = 0.5
) -> Written:
    """Voxels with an occupancy above `level`, in clay. A path ending in .vox takes one shape, any other path is a
    folder with a file for each shape.

    Raises:
        UserError: an axis longer than 256, several shapes for one file, or no shape with a voxel above the level.
        OSError: the disk. Empty shapes among others are in `Written.skipped`.
    """
    batch, path, numbered = as_batch(volumes), Path(path), names is None
    names = names_for(batch, names)
    single = is_file(path, ".vox")
    if single and len(batch) > 1:
        raise UserError(f"{path} can hold one shape, not {len(batch)}: give a folder, without the .vox")
    contents, skipped = keep_usable(names, lambda i: encode_vox(batch[i] > level, names[i]))
    files = tuple(save(path if single else path / f"{n}.vox", c) for n, c in contents.items())
    if numbered and not single:  # chosen ones may be put beside others
        warn_left(path, {file.name for file in files}, r"shape_\d+\.vox")
    return Written(files, skipped)


def encode_vox(occupied: np.ndarray, name: str = "the shape") -> bytes:
    """The content of a .vox file for one (X, Y, Z) boolean array."""
    if max(occupied.shape) > _LARGEST:
        raise UserError(f"{name} has {max(occupied.shape)} voxels along an axis and a .vox at most {_LARGEST}: use glb")
    if not occupied.any():
        raise UserError(f"{name} is empty: train longer, or sample another seed")
    x_right_z_up = occupied[:, :, ::-1].transpose(0, 2, 1)
    voxels = np.argwhere(x_right_z_up)
    coloured = np.concatenate([voxels, np.ones((len(voxels), 1), int)], axis=1).astype(np.uint8)
    chunks = (
        _chunk(b"SIZE", struct.pack("<3i", *x_right_z_up.shape))
        + _chunk(b"XYZI", struct.pack("<i", len(voxels)) + coloured.tobytes())
        + _chunk(b"RGBA", _palette())
    )
    return b"VOX " + struct.pack("<i", 150) + _chunk(b"MAIN", b"", chunks)


def _chunk(name: bytes, content: bytes, children: bytes = b"") -> bytes:
    return name + struct.pack("<2i", len(content), len(children)) + content + children


def _palette() -> bytes:
    """Colour 1 (the first entry) is clay; the others are greys for whoever paints on."""
    greys = np.repeat(np.linspace(255, 0, 255).round()[:, None], 3, axis=1)
    rgb = np.concatenate([[_CLAY], greys])
    return np.concatenate([rgb, np.full((256, 1), 255)], axis=1).astype(np.uint8).tobytes()
