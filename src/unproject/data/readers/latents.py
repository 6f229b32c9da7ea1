"""Known views that stand beside pictures or lines in an .npz."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
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
    path: Path,
    arrays: Mapping[str, np.ndarray],
    count: int,
    shape: Sequence[int],
    measured: bool,
    own: Sequence[str] = (),
) -> dict[str, Tensor] | None:
    """Return the known views, radians, and latents of one's own as they are; None if there are none.

    Args:
        path, arrays: where they are.
        count: how many there have to be.
        shape: of what they stand beside.
        measured: whether those are lines; `angle` and its spellings are theirs.
        own: names of arrays that are latents of an operator of one's own, where they are there.

    Raises:
        UserError: if they are not as many, or no numbers.
    """
    found: dict[str, np.ndarray] = {}
    views = known_latents(arrays, measured)
    for spelling, name in (views | {name: name for name in own if name in arrays and name not in views}).items():
        if name in found:
            raise UserError(f"{path}: has `{spelling}` beside another array of the same; leave one of them")
        found[name] = value = arrays[spelling]
        if value.shape != (count,) or value.dtype.kind not in "fiu" or not np.isfinite(value).all():
            exchanged = value.ndim == 1 and len(value) in shape and len(value) != count
            hint = f"; {tuple(shape)} may have its axes in another order" if exchanged else ""
            raise UserError(
                f"{path}: {spelling}: is {value.dtype} {value.shape}; give one finite number"
                f"{' of radians (or degrees)' if name in LATENTS else ''} for each of {count}{hint}"
            )
    turns = in_radians(path, {name: value for name, value in found.items() if name in LATENTS})
    others = {name: torch.from_numpy(value.astype(np.float32)) for name, value in found.items() if name not in LATENTS}
    return turns | others or None
