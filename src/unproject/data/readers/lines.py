"""Line integrals of one's own: lines, one by one, or whole sinograms; readings in any unit."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..._types import UserError
from .found import Found

LINES = ("line", "lines", "line_integrals")
SINOGRAMS = ("sinogram", "sinograms")
MOST_RADIANS = 4 * math.pi
"""Angles beyond are taken for degrees."""
MAX_ANGLE = 1e5
"""Degrees or radians; of larger ones float32 tells less than a hundredth."""
MIN_READINGS, MIN_UNEVEN, MAX_UNEVEN = 4, 0.2, 0.05
"""Detectors and angles at least, and how uneven sums over them are, if the axes are surely in another order."""


def lines_of(
    path: Path, key: str, values: Tensor, latents: Mapping[str, Tensor] | None, own: Sequence[str] = ()
) -> Found:
    """Return lines (N, 1, D): of an array (N, D) or (N, 1, D), or of sinograms (D, A) or (M, D, A).

    The A lines of a sinogram lie together and are called `00007#2`, or by its name; its A angles are those of every
    sinogram. Readings of 8 bits are numbers like others, no shares of 255.

    Args:
        path, key, values, latents: what is read, and what stands beside it.
        own: names of the lines or sinograms, if there is one for each.

    Raises:
        UserError: for an array of another shape, or angles that are not as many.
    """
    if key in SINOGRAMS:
        values = values[None] if values.ndim == 2 else values
        expected = "sinograms are (M, D, A), detectors by angles, or one (D, A)"
    else:
        values = values[:, None] if values.ndim == 2 else values
        expected = "line integrals are (N, D) or (N, 1, D)"
    if values.ndim != 3 or (key in LINES and values.shape[1] != 1):
        raise UserError(f"{path}: {key}: is of shape {tuple(values.shape)}; {expected}")
    values = values.float()
    names = [*own] if len(own) == len(values) else [f"{i:05d}" for i in range(len(values))]
    if key in LINES:
        return Found(values, names, latents, source=str(path))
    count, detectors, angles = values.shape
    if min(detectors, angles) >= MIN_READINGS and _uneven(values, 1) > MIN_UNEVEN and _uneven(values, 2) < MAX_UNEVEN:
        warnings.warn(
            f"{path}: {key}: sums along the last axis are alike, as those over detectors are at all angles; sinograms "
            "are (M, D, A), detectors by angles; if this is (M, A, D), save array.swapaxes(1, 2)",
            stacklevel=2,
        )
    names = [f"{name}#{k}" for name in names for k in range(angles)]
    repeated = None if latents is None else {name: angle.repeat(count) for name, angle in latents.items()}
    return Found(values.mT.reshape(-1, 1, detectors), names, repeated, source=str(path))


def _uneven(sinograms: Tensor, axis: int) -> float:
    """Return how much sums along an axis differ over the other, deviation over mean, in the middle of the sinograms."""
    sums = sinograms.float().sum(axis)
    return float((sums.std(1) / sums.mean(1).abs().clamp_min(1e-9)).median())


def count_of_angles(key: str, values: Tensor) -> int:
    """Return how many known angles stand beside an array: one an item, of sinograms one a column."""
    return values.shape[-1] if key in SINOGRAMS else len(values)


def in_radians(path: Path, latents: Mapping[str, np.ndarray]) -> dict[str, Tensor]:
    """Return angles in radians; those of a file of which one is beyond 4 π are taken for degrees, which is said.

    Raises:
        UserError: for what is too large for an angle, and for elevations beyond a pole.
    """
    found = {name: torch.from_numpy(value.astype(np.float64)) for name, value in latents.items()}
    for name, angle in found.items():
        if bool((angle.abs() > MAX_ANGLE).any()):
            raise UserError(f"{path}: {name}: has {angle.abs().max():g}; give angles of at most {MAX_ANGLE:g}")
    if any(bool((angle.abs() > MOST_RADIANS).any()) for angle in found.values()):
        ranges = ", ".join(f"{name} from {angle.min():g} to {angle.max():g}" for name, angle in found.items())
        warnings.warn(f"{path}: {ranges}: looks like degrees and is taken so; radians are at most 4 π", stacklevel=2)
        found = {name: angle.deg2rad() for name, angle in found.items()}
    steepest = found["elevation"].abs().max().rad2deg() if found.get("elevation", torch.empty(0)).numel() else 0
    if steepest > 90.001:  # float32 radians of 90 degrees are a little more
        raise UserError(f"{path}: an elevation of {steepest:g} degrees is beyond a pole; give -90 to 90 degrees")
    return {name: angle.float() for name, angle in found.items()}
