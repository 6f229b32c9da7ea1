"""The visual hull: the largest volume with the same silhouettes (Laurentini 1994).

H(x, y, z) = min_k S_k(u_k(x, z), y),   S_k(j, y) = max of v over the voxels (x, z) whose u_k falls in column j

with orthographic views k at elevation 0, u_k = x cos a_k - z sin a_k and columns one voxel wide. As it consists of
maxima and minima, it commutes with thresholding. On the grid H >= v and hull(H) = H exactly.

A soft volume may look opaque where no voxel is half full. With a density d the silhouettes are those of absorption,
S_k = 1 - exp(-d Σ v) over the same voxels, and H = max(v, f(min_k S_k)): what looks opaque becomes a body, mist stays
mist. f(s) is s from ½ on and 4 s³ below: a ray of 64 voxels that absorbs 2 % would absorb 92 % (d = 2) if each did.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .._types import UserError
from .resampling import centres


def visual_hull(volume: Tensor, views: int = 16, density: float | None = None) -> Tensor:
    """Compute the visual hull from `views` cameras at elevation 0; it fills cavities and concavities.

    The views are at azimuths k π / views, half a turn: the opposite view has the mirrored silhouette.

    Args:
        volume: (B, X, Y, Z).
        views: number of cameras.
        density: of a full voxel, for silhouettes by absorption (default: by the largest value along each ray).

    Returns:
        (B, X, Y, Z), at least `volume` everywhere.

    Raises:
        UserError: for fewer than one view.

    Examples:
        >>> import torch, unproject as up
        >>> shell = torch.ones(1, 6, 6, 6)
        >>> shell[:, 2:4, 2:4, 2:4] = 0
        >>> up.ops.visual_hull(shell).min()
        tensor(1.)
    """
    if views < 1:
        raise UserError(f"visual_hull(views={views}): give at least 1")
    hull = torch.full_like(volume, math.inf)
    for k in range(views):
        columns = _columns(volume, math.pi * k / views)
        hull = torch.minimum(hull, _cast_back(volume, columns, density))
    return hull if density is None else torch.maximum(volume, torch.where(hull < 0.5, 4 * hull**3, hull))


def _columns(volume: Tensor, azimuth: float) -> Tensor:
    """Return the picture column (X, Z) that each place projects to; columns are as wide as a voxel."""
    width, depth = volume.shape[1], volume.shape[3]
    widest = max(width, depth)
    x, z = centres(width, volume)[:, None], centres(depth, volume)
    u = (x * math.cos(azimuth) - z * math.sin(azimuth)) * widest / 2
    margin = math.ceil((math.hypot(width, depth) - widest) / 2)
    # The offset keeps a wall edge-on at 45°, where rounding would decide the column, in one column.
    return (u + widest / 2 + margin + 1e-3).floor().long()


def _cast_back(volume: Tensor, columns: Tensor, density: float | None) -> Tensor:
    """Return the value of the silhouette S at the column of each place."""
    planes = volume.transpose(2, 3).flatten(1, 2)
    index = columns.flatten()
    silhouette = planes.new_zeros(len(volume), int(index.max()) + 1, volume.shape[2])
    if density is None:
        everywhere = index[:, None].expand_as(planes)
        silhouette = silhouette.scatter_reduce(1, everywhere, planes, "amax", include_self=False)
    else:
        silhouette = -torch.expm1(-density * silhouette.index_add(1, index, planes))
    return silhouette[:, index].unflatten(1, columns.shape).transpose(2, 3)
