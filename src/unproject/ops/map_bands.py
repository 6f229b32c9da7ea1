"""The bands of the maps of a material, by scale, which correlations between maps are of.

Four fields of a material (B, 8, H, W) or (B, 10, H, W):

    diffuse     luminance 0.2126 R + 0.7152 G + 0.0722 B of the diffuse albedo
    specular    specular albedo, the luminance of a coloured one
    roughness   roughness
    normal      height h whose slopes the normals are: argmin_h Σ |∇h - g|², g = (-n_x / n_z, -n_y / n_z)

h in texels. n_z is clamped at 0.1; the material's mean slope is subtracted first, so that a tilted sample is not a
ramp. The least-squares problem has natural boundary conditions: Δh = div g, solved by a cosine transform.

Each field is split into the bands of a Laplacian pyramid (see `pyramids`) down to a shorter side of 8; the low-pass
rest is taken less the material's mean. Scales are named by that side, "64" being the finest of 64² maps. The last
scale, "mean", has one value a material: the mean of the field or, for the normal, whose mean height is undetermined,
the RMS of |g|. All of it is differentiable.

References:
    Frankot and Chellappa, A method for enforcing integrability in shape from shading algorithms, 1988 (h).
"""

from __future__ import annotations

import math
from functools import lru_cache

import torch
from torch import Tensor

from .maps import luminance, unpack_maps, with_specular
from .pyramids import laplacian_pyramid

SMALLEST = 8
LEAST_Z = 0.1
MEAN = "mean"
"""The name of the last scale, of one value a material."""


def map_bands(maps: Tensor) -> dict[str, Tensor]:
    """Return the band (n, 4, h, w) of the fields at each scale, finest first; of "mean" (n, 4).

    Examples:
        >>> import torch, unproject as up
        >>> bands = up.ops.map_bands(torch.rand(3, 8, 16, 16) + 0.1)
        >>> {scale: tuple(band.shape) for scale, band in bands.items()}
        {'16': (3, 4, 16, 16), '8': (3, 4, 8, 8), 'mean': (3, 4)}
    """
    maps = with_specular(maps, 1)
    slopes = _slopes(unpack_maps(maps)["normal"])
    x = torch.cat([_albedos(maps), heights(slopes)], 1)
    mean = x.mean((2, 3), keepdim=True)
    bands = laplacian_pyramid(x - mean, SMALLEST)
    bands[-1] = bands[-1] - bands[-1].mean((2, 3), keepdim=True)
    rms_slope = slopes.square().sum(1).mean((1, 2)).sqrt()
    return {str(min(band.shape[-2:])): band for band in bands} | {
        MEAN: torch.cat([mean[:, :3, 0, 0], rms_slope[:, None]], 1)
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
