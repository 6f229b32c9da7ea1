"""Volumes in arrays, which are taken as they are: what nothing can be learned from, and what is full outside."""

from __future__ import annotations

import warnings
from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from ..._types import UserError
from ..sampling import spread_rows
from .found import Found, chunks, to_floats, white_of, without

EMPTY = "empty: no voxel is occupied"
"""Why a volume is left out: none of its voxels is above half of white."""
LOOKED_AT = 64
"""Volumes that are looked at to tell whether all are inverted."""
FULL = 0.99
"""Share of voxels from which on a volume is a block that fills its grid."""


def cubes(path: Path, key: str, values: Tensor) -> Tensor:
    """Return volumes (N, X, Y, Z) of (N, X, Y, Z) or (N, 1, X, Y, Z).

    Raises:
        UserError: if they are none, or not as long on each side.
    """
    values = values[:, 0] if values.ndim == 5 and values.shape[1] == 1 else values
    if values.ndim != 4 or len(set(values.shape[1:])) != 1:
        raise UserError(f"{path}: {key}: is of shape {tuple(values.shape)}; volumes are (N, X, Y, Z) with X = Y = Z")
    return values


def occupied(found: Found, size: int | None, strict: bool) -> Found:
    """Return what was found at a size (see `resized_volumes`), without the volumes in which no voxel is occupied.

    A voxel is occupied above half of white. Volumes of objects cut out of full blocks are inverted, with a warning.

    Raises:
        UserError: if none is left, each fills its grid, or one is left out and `strict` is given.
    """
    volumes, white = found.whole, white_of(found.items)
    inverted = _are_inverted(volumes, white)
    if inverted:
        _warn_of_inversion(found.source)
        volumes = white - volumes
    ends = [(part.flatten(1).amin(1), part.flatten(1).amax(1)) for part in chunks(volumes)]
    least, most = (torch.cat(values).float() / white for values in zip(*ends, strict=True))
    if not bool((most > 0.5).any()):
        raise UserError(f"{found.source}: no volume has an occupied voxel{_of_values(volumes, most, white)}")
    if bool((least > 0.5).all()):
        raise UserError(f"{found.source}: all voxels of all volumes are occupied; volumes are 1 inside, 0 outside")
    found, rows = without(found, most <= 0.5, EMPTY, strict)
    return found._replace(items=resized_volumes(volumes if rows is None else volumes[rows], size))


def _of_values(volumes: Tensor, most: Tensor, white: int) -> str:
    """Say what the values of volumes are, none of which is above half of white, and what to save."""
    highest = float(most.max())
    if highest == 0:
        return "; volumes are 1 inside, 0 outside"
    values = f"{highest:.3g} of 1" if volumes.is_floating_point() else f"{highest * white:.0f} of {white}"
    return f": values are {values} at most; of labels save volumes > 0, else scale them to 1 inside, 0 outside"


def _are_inverted(volumes: Tensor, white: int) -> bool:
    """Whether most volumes, of a spread of them, are occupied along nine tenths of their faces, but not throughout."""
    rows = spread_rows(len(volumes), LOOKED_AT).tolist()
    return 2 * sum(_is_inverted(to_floats(volumes[row], white) > 0.5) for row in rows) > len(rows)


def _is_inverted(x: Tensor) -> bool:
    faces = torch.stack([x[0], x[-1], x[:, 0], x[:, -1], x[:, :, 0], x[:, :, -1]])
    return bool(faces.float().mean() > 0.9) and bool(x.float().mean() <= FULL)


def _warn_of_inversion(source: str) -> None:
    warnings.warn(
        f"{source}: most volumes are occupied along their outer faces, so that they are taken for objects cut out of "
        "full blocks; save 1 inside of objects and 0 outside",
        stacklevel=3,
    )


def resized_volumes(volumes: Tensor, size: int | None) -> Tensor:
    """Volumes (N, X, X, X) at (N, size, size, size).

    A grid smaller by at most an eighth is padded with empty voxels, which keeps every voxel as it is (30 to 32);
    otherwise values are area averages when it shrinks, trilinear when it grows.
    """
    now = volumes.shape[-1]
    if size is None or now == size:
        return volumes
    if now < size <= now * 9 / 8:
        before = (size - now) // 2
        return functional.pad(volumes, (before, size - now - before) * 3)
    values = to_floats(volumes, white_of(volumes))[:, None]
    if size < now:
        return functional.interpolate(values, size=(size,) * 3, mode="area")[:, 0]
    return functional.interpolate(values, size=(size,) * 3, mode="trilinear", align_corners=False)[:, 0]
