"""Inflated: the preference for shapes as thick as they look wide."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .._types import UserError
from ..ops.widths import local_widths
from .regularisers import TINY


@dataclass(frozen=True)
class Inflated:
    """w E[Σ m (min(d, a h) - t)₊ / (X Σ m)]: prefer shapes that are as thick along x as they look wide from there.

    m = (1 - 2 exp(-density Σ_x p))₊ is the silhouette along x, without haze: what absorbs less than half of the light
    may be on its way out, and is not to be filled. d is its local width (`ops.local_widths`), h its height, and t the
    extent along x, from the first to the last full voxel: Σ_x min(1, Σ_{x' ≤ x} p) min(1, Σ_{x' ≥ x} p). m, d and h
    have no gradient: thin places become thicker, and wide ones not narrower.

    If pictures show objects from one side alone, nothing in them tells how thick these are across their plane of
    symmetry, x = 0, and flat boards match them as well as bodies. Most objects are as thick as they look wide, a seat
    or a belly. A fish is not; but then some pictures are narrow, those from the front, and with a as narrow as the
    narrowest, width over height, no place is asked to be thicker than what they can show. Thin legs and wings seen
    edge-on look thin, and are not pushed.

    Args:
        weight: w.
        narrowest: a.
        density: a full voxel absorbs 1 - exp(-density).
        volumes: the mean is taken of so many volumes of the batch, to save time; as codes are drawn independently, its
            expectation is that of all.

    Raises:
        UserError: for a weight below 0, a width or density that is not positive, or no volume.

    References:
        Igarashi, Matsuoka and Tanaka 1999, Teddy: outlines are inflated so that wide places are thick.

    Examples:
        >>> import torch, unproject as up
        >>> board, block = torch.zeros(2, 1, 16, 16, 16)
        >>> board[:, 7:9, 4:12, 4:12], block[:, 4:12, 4:12, 4:12] = 1, 1
        >>> up.Inflated(1.0, density=20.0)(board, progress=0.0) > up.Inflated(1.0, density=20.0)(block, progress=0.0)
        tensor(True)
    """

    weight: float = 10.0
    narrowest: float = math.inf
    density: float = 2.0
    volumes: int = 16

    def __post_init__(self) -> None:
        if not (0 <= self.weight < math.inf and 0 < self.density < math.inf and self.volumes >= 1):
            raise UserError(f"{self}: give a weight of 0 or more, a positive density and at least one volume")
        if not self.narrowest > 0:
            raise UserError(f"{self}: narrowest is a width over a height; give one above 0")

    def __call__(self, x: Tensor, progress: float) -> Tensor:
        """Return the term of volumes x (B, X, Y, Z), whatever is spent of the budget."""
        x = x[: self.volumes]
        seen = (1 - 2 * torch.exp(-self.density * x.detach().sum(1))).clamp_min(0)
        heights = (seen.amax(2) > 0).sum(1)[:, None, None].clamp_min(1)
        widths = torch.minimum(local_widths(seen), self.narrowest * heights)
        share = seen / (seen.sum((1, 2), keepdim=True) + TINY) / len(x) / x.shape[1]
        wide = _counted(widths.flatten())
        columns = x.transpose(0, 1).flatten(1).index_select(1, wide)
        before, behind = columns.cumsum(0).clamp(max=1), columns.flip(0).cumsum(0).flip(0).clamp(max=1)
        short = (widths.flatten()[wide] - (before * behind).sum(0)).clamp_min(0)
        return self.weight * (share.flatten()[wide] * short).sum()


def _counted(widths: Tensor) -> Tensor:
    """Return the columns (N,) that may count: most are empty or thin. On a GPU all, as it would be waited for."""
    on_processor = widths.device.type == "cpu"
    return widths.nonzero()[:, 0] if on_processor else torch.arange(len(widths), device=widths.device)
