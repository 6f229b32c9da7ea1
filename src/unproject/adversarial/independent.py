"""Independent: of all maps that photographs agree with, those that depend least on one another."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .._types import UserError
from ..ops.map_bands import MEAN, map_bands

LEAST_VARIANCE = 1e-10
"""Added to variances, so that maps without any contrast have a gradient."""


@dataclass(frozen=True)
class Independent:
    """w E ρ²: prefer materials whose maps do not go together, as long as photographs leave it open.

    ρ are the six correlations of luminance, specular albedo, roughness and height over the texels of all materials of
    the batch, at each scale (`ops.map_bands`, without the means of materials), and E their mean. The weight falls
    linearly from `weight` to 0 when `until`, a part of the budget, is spent: how maps go together is decided early,
    when contrasts are still wrong, and a map that follows another one in place of its own noise has no gradient away
    from it (correlations fall with the square of what is its own). Photographs have the last word.

    Examples:
        >>> import torch, unproject as up
        >>> gloss = torch.rand(4, 1, 16, 16)
        >>> flat = torch.tensor([0.0, 0.0, 1.0])[:, None, None].expand(4, 3, 16, 16)
        >>> maps = torch.cat([torch.rand(4, 3, 16, 16), gloss, gloss, flat], 1)
        >>> up.Independent()(maps, progress=0.0) > 0.3
        tensor(True)
        >>> up.Independent()(maps, progress=0.6)
        tensor(0.)
    """

    weight: float = 2.0
    until: float = 0.6

    def __post_init__(self) -> None:
        if not (0 <= self.weight < math.inf and 0 < self.until <= 1):
            raise UserError(f"{self}: give a weight of 0 or more, and until above 0 and at most 1")

    def __call__(self, x: Tensor, progress: float) -> Tensor:
        """Return the term of materials x (B, 8 or 10, H, W) when `progress`, a part of the budget, is spent."""
        weight = self.weight * max(0.0, 1 - progress / self.until)
        if weight == 0:
            return x.new_zeros(())
        bands = map_bands(x.float())
        return weight * torch.stack([_squares(band) for scale, band in bands.items() if scale != MEAN]).mean()


def _squares(band: Tensor) -> Tensor:
    """Return ρ² of the six pairs of a band (B, 4, h, w)."""
    fields = band.transpose(0, 1).flatten(1)
    fields = fields - fields.mean(1, keepdim=True)
    fields = fields * (fields.square().mean(1, keepdim=True) + LEAST_VARIANCE).rsqrt()
    i, j = torch.triu_indices(len(fields), len(fields), 1, device=band.device)
    return (fields @ fields.T / fields.shape[1])[i, j].square()
