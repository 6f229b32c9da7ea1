"""Correlations between the maps of materials by scale, such as of roughness with colour or of relief with gloss.

Four fields of a material (B, 8, H, W) or (B, 10, H, W):

    diffuse     luminance 0.2126 R + 0.7152 G + 0.0722 B of the diffuse albedo
    specular    specular albedo, the luminance of a coloured one
    roughness   roughness
    normal      height h whose slopes the normals are: argmin_h Σ |∇h - g|², g = (-n_x / n_z, -n_y / n_z)

h in texels. n_z is clamped at 0.1; the material's mean slope is subtracted first, so that a tilted sample is not a
ramp. The least-squares problem has natural boundary conditions: Δh = div g, solved by a cosine transform.

Each field is split into the bands of a Laplacian pyramid (see `patches`) down to a shorter side of 8; the low-pass rest
is taken less the material's mean. Scales are named by that side, "64" being the finest of 64² maps. The last scale,
"mean", has one value a material: the mean of the field or, for the normal, whose mean height is undetermined, the RMS
of |g|. For fields a, b at a scale, over all texels of all materials,

    ρ = cov(a, b) / √(var(a) var(b)),     0 if a deviation is below 1e-5

and the error of a generated set is the root mean square of ρ_generated - ρ_true over scales and the six pairs. The
distributions of single maps do not enter: of all scores, only this one detects maps shuffled among the materials.
Texels of a scale are pooled, so materials of high contrast have most weight. For samples of N materials the error is
about 1/√N at "mean" and less at finer scales.

References:
    Li, Dong, Peers and Tong, CVPR 2019: separate projections of the maps keep them corresponding.
    Frankot and Chellappa, A method for enforcing integrability in shape from shading algorithms, 1988 (h).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import torch
from torch import Tensor

from .._types import UserError
from ..ops.maps import MAPS, luminance, unpack_maps, with_specular
from ..ops.pyramids import laplacian_pyramid
from .distances import check_set
from .patches import check_pair, chunks

FIELDS = tuple(MAPS)
PAIRS = tuple(combinations(FIELDS, 2))
SMALLEST = 8
LEAST_Z = 0.1
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
        for scale, band in _bands(with_specular(part, 1)).items():
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


def _bands(maps: Tensor) -> dict[str, Tensor]:
    """Return the band (n, 4, h, w) of the fields at each scale; "mean" is (n, 4)."""
    slopes = _slopes(unpack_maps(maps)["normal"])
    x = torch.cat([_albedos(maps), heights(slopes)], 1)
    mean = x.mean((2, 3), keepdim=True)
    bands = laplacian_pyramid(x - mean, SMALLEST)
    bands[-1] = bands[-1] - bands[-1].mean((2, 3), keepdim=True)
    rms_slope = slopes.square().sum(1).mean((1, 2)).sqrt()
    return {str(min(band.shape[-2:])): band for band in bands} | {
        "mean": torch.cat([mean[:, :3, 0, 0], rms_slope[:, None]], 1)
    }


def _albedos(maps: Tensor) -> Tensor:
    """Return luminance, specular and roughness, (n, 3, H, W)."""
    found = unpack_maps(maps)
    return torch.cat([luminance(found["diffuse"]), found["specular"], found["roughness"]], 1)


def _slopes(normal: Tensor) -> Tensor:
    """Return ∂h along columns (x) and rows (-y) in texels, (n, 2, H, W), less their means."""
    x, y, z = normal.unbind(1)
    slopes = torch.stack([-x, y], 1) / z.clamp_min(LEAST_Z)[:, None]
    return slopes - slopes.mean((2, 3), keepdim=True)


def heights(slopes: Tensor) -> Tensor:
    """Return the height (n, 1, H, W), of mean 0, that best fits slopes (n, 2, H, W) along columns and rows.

    In the least-squares sense, with the mean of the slopes of two neighbours as the target of their difference.
    """
    along, down = slopes[:, 0], slopes[:, 1]
    zero = torch.nn.functional.pad
    flow = zero((along[:, :, 1:] + along[:, :, :-1]) / 2, (1, 1)).diff(dim=2)
    flow = flow + zero((down[:, 1:] + down[:, :-1]) / 2, (0, 0, 1, 1)).diff(dim=1)
    (rows, values), (columns, others) = (_cosines(side) for side in slopes.shape[-2:])
    eigenvalues = values[:, None] + others
    eigenvalues[0, 0] = -math.inf
    return (rows.T @ (rows @ flow @ columns.T / eigenvalues) @ columns)[:, None]


@lru_cache(maxsize=16)
def _cosines(n: int) -> tuple[Tensor, Tensor]:
    """Return eigenvectors (rows) and eigenvalues of the second difference of n samples with natural ends."""
    k = torch.arange(n, dtype=torch.float64)
    basis = torch.cos(math.pi / n * k[:, None] * (k + 0.5)) * math.sqrt(2 / n)
    basis[0] /= math.sqrt(2)
    return basis.float(), (2 * torch.cos(math.pi / n * k) - 2).float()
