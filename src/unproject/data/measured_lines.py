"""Line integrals of one's own as `LineIntegral` makes them: about the middle, from half a turn, in image widths.

A picture x in [0, 1] that is learned of readings r in some unit, D detectors wide, with the divisor s of `scale_of`,
is x s / D of what was summed, in that unit a detector's width.
"""

from __future__ import annotations

import math
import warnings

import torch
from torch import Tensor

from .._types import UserError
from ..ops.detectors import about_middle
from .collection import Collection
from .sampling import spread_rows

MAX_LINES = 4096
"""Lines that are looked at to tell the scale of readings."""
MAX_UNSCALED, MIN_UNSCALED = 1.0, 0.1
"""Readings in image widths, the largest of a thousand: 1 at most, of an image of ones; handwritten digits have 0.6."""
TYPICAL = 0.5
EDGE = 1e-6
"""Radians that an angle is kept from the ends of the half turn, so that rounding to float32 does not take it out."""
INTENSITIES = "lines are higher at both ends than in the middle, as intensities are: take -log(I / I0) of those"
TOLD, HIGHER = 20, 1.1
"""Lines at least, and how much higher their ends are than the middle, if they surely are."""
UNTOLD = 1e-12
"""Mean square below which nothing is seen of a direction of (c, x, y)."""
NEGATIVE = 0.1
"""How far below 0, as a share of the largest, detectors of line integrals may read on average."""
NOISY = (
    "readings scatter below 0 by {:.0%} of the largest: training knows no noise, so that images learn it as if it were "
    "theirs; average neighbouring readings, or train an operator of your own that adds such noise"
)


def standardised_lines(found: Collection, bins: int, scale: float = 1.0, center: float | None = None) -> Collection:
    """Return measured lines as `bins` directions without gaps make them (`projections.directions`).

    Args:
        found: lines (N, 1, D), with or without known angles.
        bins: directions over half a turn.
        scale: what readings are divided by (`scale_of`).
        center: the detector, counted from 0, that the axis of rotation projects to (default: (D - 1) / 2).

    Raises:
        UserError: for a center outside of the detectors, or a scale that is not positive.
    """
    if not 0 < scale < math.inf:
        raise UserError(f"{found.source}: scale={scale:g}: give what readings are divided by, a positive number")
    readings, latents = found.floats(), found.latents
    if are_intensities(readings):
        warnings.warn(f"{found.source}: {INTENSITIES}", stacklevel=2)
    lines = about_middle(readings, center, found.source)
    if latents is not None and "angle" in latents:
        lines, angle = within_half_turn(lines, latents["angle"], math.pi / 2 / bins)
        latents = latents | {"angle": angle}
    return Collection(lines / scale, names=found.names, latents=latents, skipped=found.skipped, source=found.source)


def are_intensities(lines: Tensor) -> bool:
    """Whether lines (N, 1, D) are on average higher at both ends than in the middle, as those of no object are."""
    profile = lines.mean((0, 1))
    end, quarter = -(-len(profile) // 8), len(profile) // 4
    middle = profile[quarter : len(profile) - quarter].mean()
    return len(lines) >= TOLD and bool(min(profile[:end].mean(), profile[-end:].mean()) > HIGHER * middle)


def center_of(lines: Tensor, angle: Tensor) -> tuple[float, float]:
    """Return the detector that the axis of rotation projects to, by the readings, and its standard error.

    The centroid of a line at angle φ is c + x cos φ + y sin φ with the centre of mass (x, y) of its object (one of the
    Helgason-Ludwig conditions): c is found by least squares, with the mean centre of all objects. The error is vast
    where angles do not tell c from the centre, as two directions do not.

    Examples:
        >>> import torch
        >>> angle = torch.linspace(0, 6, 60)
        >>> place = torch.arange(16.0)
        >>> lines = (-((place - 7 - 2 * angle.cos()[:, None]) ** 2)).exp()[:, None]
        >>> center, error = center_of(lines, angle)
        >>> round(center, 2), error < 0.01
        (7.0, True)
    """
    mass = lines[:, 0].double()
    seen = mass.sum(1) > 0
    mass, angle = mass[seen], angle[seen].double()
    places = (mass * torch.arange(mass.shape[1])).sum(1) / mass.sum(1)
    waves = torch.stack([torch.ones_like(angle), angle.cos(), angle.sin()], 1)
    found = torch.linalg.lstsq(waves, places[:, None], driver="gelsd").solution[:, 0]
    deviation = (places - waves @ found).std() if len(places) > 3 else torch.tensor(math.inf)
    size, axes = torch.linalg.eigh(waves.T @ waves / len(waves))
    variance = (axes[0].square() / size.clamp_min(UNTOLD)).sum() / len(waves)
    return found[0].item(), (deviation * variance.sqrt()).item()


def within_half_turn(lines: Tensor, angle: Tensor, before: float = 0.0) -> tuple[Tensor, Tensor]:
    """Return lines (N, 1, D) and their angles (N,) in [-before, π - before), radians: half a turn on they are reversed.

    Examples:
        >>> import math, torch
        >>> within_half_turn(torch.tensor([[[1.0, 2.0]]]), torch.tensor([1.5 * math.pi]))
        (tensor([[[2., 1.]]]), tensor([1.5708]))
    """
    turns = torch.floor((angle.double() + before) / math.pi)
    folded = (angle.double() - math.pi * turns).clamp(EDGE - before, math.pi - before - EDGE).float()
    odd = (turns % 2 == 1).view(-1, 1, 1)
    return torch.where(odd, lines.flip(-1), lines), folded


def scale_of(found: Collection) -> float:
    """Return s such that readings / s are in image widths, 1 for those that can be as they are.

    The least reading that 999 of 1000 do not exceed becomes 0.5, so that images of ones to 50 % of their width are
    within reach, as are fainter ones of any size.

    Raises:
        UserError: for readings that are 0, or negative on average at some detectors, as no noise is.

    Warns:
        UserWarning: for noise below 0.
    """
    readings = found.batch(spread_rows(len(found), MAX_LINES)).double()
    lines, profile = readings.flatten(), readings.flatten(0, 1).mean(0)
    ordered = lines.sort().values
    low, high = ordered[len(ordered) // 100].item(), ordered[-1 - len(ordered) // 1000].item()
    enough = len(readings) >= TOLD  # of few lines the mean of a detector is as noisy as a reading
    if high <= 0 or (profile.min().item() if enough else low) < -NEGATIVE * high:
        raise UserError(
            f"{found.source}: readings run from {lines.min():g} to {lines.max():g}; line integrals are sums of what is "
            "not negative: take -log(I / I0) of intensities, and subtract what is read beside the object"
        )
    if low < -NEGATIVE * high:
        warnings.warn(f"{found.source}: {NOISY.format(-low / high)}", stacklevel=2)
    return 1.0 if high >= MIN_UNSCALED and lines.max() <= MAX_UNSCALED else float(f"{high / TYPICAL:.4g}")
