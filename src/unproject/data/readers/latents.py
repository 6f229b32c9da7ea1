"""Known views that stand beside pictures or lines in an .npz."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
from torch import Tensor

from ..._types import UserError
from .lines import in_radians

LATENTS = {
    "azimuth": ("azimuth", "azimuths"),
    "elevation": ("elevation", "elevations"),
    "angle": ("angle", "angles", "theta", "thetas"),
}
"""Known views, and the names that an array of them may have."""


def known_latents(arrays: Iterable[str], measured: bool) -> dict[str, str]:
    """Return the spellings that are among some names, and the latent that each stands for.

    Args:
        measured: whether they stand beside lines; `angle` and its spellings are theirs.
    """
    there = set(arrays)
    found = {}
    for name, spellings in LATENTS.items():
        spellings = spellings if measured or name != "angle" else spellings[:1]  # of pictures theta may be anything
        found |= {spelling: name for spelling in spellings if spelling in there}
    return found


def latents_of(
    path: Path, arrays: Mapping[str, np.ndarray], count: int, shape: Sequence[int], measured: bool
) -> dict[str, Tensor] | None:
    """Return the known views, radians, None if there are none.

    Args:
        path, arrays: where they are.
        count: how many there have to be.
        shape: of what they stand beside.
        measured: whether those are lines; `angle` and its spellings are theirs.

    Raises:
        UserError: if they are not as many, or no numbers.
    """
    found = {}
    for spelling, name in known_latents(arrays, measured).items():
        if name in found:
            raise UserError(f"{path}: has `{spelling}` beside another array of the same; leave one of them")
        found[name] = value = arrays[spelling]
        if value.shape != (count,) or value.dtype.kind not in "fiu" or not np.isfinite(value).all():
            exchanged = value.ndim == 1 and len(value) in shape and len(value) != count
            hint = f"; {tuple(shape)} may have its axes in another order" if exchanged else ""
            raise UserError(
                f"{path}: {spelling}: is {value.dtype} {value.shape}; give one finite number of radians (or "
                f"degrees) for each of {count}{hint}"
            )
    return in_radians(path, found) or None
