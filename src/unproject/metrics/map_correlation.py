"""Correlations between the maps of materials by scale, such as of roughness with colour or of relief with gloss.

Of the bands of four fields at each scale, luminance of the diffuse albedo, specular albedo, roughness and height, and
of their means ("mean"; `ops.map_bands`). For fields a, b at a scale, over all texels of all materials,

    ρ = cov(a, b) / √(var(a) var(b)),     0 if a deviation is below 1e-5

and the error of a generated set is the root mean square of ρ_generated - ρ_true over scales and the six pairs. The
distributions of single maps do not enter: of all scores, only this one detects maps shuffled among the materials.
Texels of a scale are pooled, so materials of high contrast have most weight. For samples of N materials the error is
about 1/√N at "mean" and less at finer scales.

References:
    Li, Dong, Peers and Tong, CVPR 2019: separate projections of the maps keep them corresponding.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import torch
from torch import Tensor

from .._types import UserError
from ..ops.map_bands import SMALLEST, map_bands
from ..ops.maps import MAPS, unpack_maps
from .distances import check_set
from .patches import check_pair, chunks

FIELDS = tuple(MAPS)
PAIRS = tuple(combinations(FIELDS, 2))
FLAT = 1e-5


@dataclass(frozen=True)
class CorrelationTable:
    """Correlations of `PAIRS` at each scale.

    Attributes:
        scales: names, finest first; the last is "mean".
        values: (scales, 6) in [-1, 1].
    """

    scales: tuple[str, ...]
    values: Tensor


@dataclass(frozen=True)
class CorrelationError:
    """Two tables of the same scales, and root mean squares of their differences."""

    generated: CorrelationTable
    truth: CorrelationTable

    @property
    def overall(self) -> float:
        """Over all scales and pairs."""
        return self._square().mean().sqrt().item()

    def by_scale(self) -> dict[str, float]:
        """Return the error of each scale, over pairs."""
        return dict(zip(self.truth.scales, self._square().mean(1).sqrt().tolist()))

    def by_pair(self) -> dict[tuple[str, str], float]:
        """Return the error of each pair of maps, over scales."""
        return dict(zip(PAIRS, self._square().mean(0).sqrt().tolist()))

    def _square(self) -> Tensor:
        return (self.generated.values - self.truth.values).square()


@torch.no_grad()
def correlation_error(generated: Tensor, truth: Tensor) -> CorrelationError:
    """Compare the cross-map correlations of generated materials (G, C, H, W) with those of true ones (T, C, H, W).

    Raises:
        UserError: for sets of fewer than two materials, different sizes, sides below 16, or NaN.
    """
    check_pair(generated, truth, what="materials")
    return CorrelationError(map_correlations(generated), map_correlations(truth))


@torch.no_grad()
def map_correlations(maps: Tensor) -> CorrelationTable:
    """Compute the correlations between the four fields of materials (N, 8 or 10, H, W) at each scale.

    Raises:
        UserError: for fewer than two materials, other than 8 or 10 channels, a side below 8, or NaN.
    """
    unpack_maps(maps)
    if len(maps) < 2 or min(maps.shape[-2:]) < SMALLEST:
        raise UserError(f"map correlations: give at least 2 materials of 8x8 texels or more, not {tuple(maps.shape)}")
    check_set(maps, "of materials")
    moments: dict[str, Tensor] = {}
    for part in chunks(maps):
        for scale, band in map_bands(part).items():
            samples = band.transpose(0, 1).flatten(1).double()
            samples = torch.cat([torch.ones_like(samples[:1]), samples])
            moments[scale] = moments.get(scale, 0) + samples @ samples.T
    return CorrelationTable(tuple(moments), torch.stack([_correlations(value) for value in moments.values()]))


def _correlations(moments: Tensor) -> Tensor:
    """Compute Pearson's ρ of each pair from the sums (5, 5) of products of (1, fields)."""
    mean, square = moments[0, 1:] / moments[0, 0], moments[1:, 1:] / moments[0, 0]
    covariance = square - mean * mean[:, None]
    deviation = covariance.diag().clamp_min(0).sqrt()
    sound = deviation > FLAT
    correlation = covariance / (deviation * deviation[:, None]).clamp_min(FLAT**2) * (sound & sound[:, None])
    i, j = torch.triu_indices(*covariance.shape, offset=1)
    return correlation[i, j].clamp(-1, 1)
