"""The visual hull: the largest volume that casts the same silhouettes (Laurentini 1994).

H(x, y, z) = min_k S_k(u_k(x, z), y),   S_k(j, y) = max of v over the voxels (x, z) whose u_k falls in column j

with level orthographic views k, u_k = x cos a_k - z sin a_k and columns one voxel wide. Defined by maxima and
minima, it commutes with thresholding: the hull of a soft volume is soft. On the grid H >= v and hull(H) = H exactly.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from .resampling import centres


def visual_hull(volume: Tensor, views: int = 16) -> Tensor:
    """Fill what none of `views` level cameras can see to be empty: cavities and the insides of hollows.

    The views stand at azimuths k π / views: half a turn, as the opposite view is the mirror image.

    Args:
        volume: (B, X, Y, Z).

    Returns:
        (B, X, Y, Z), at least `volume` everywhere.
    """
    hull = torch.full_like(volume, math.inf)
    for k in range(views):
        columns = _columns(volume, math.pi * k / views)
        hull = torch.minimum(hull, _cast_back(volume, columns))
    return hull


def _columns(volume: Tensor, azimuth: float) -> Tensor:
    """(X, Z) picture column in which each place is seen, the columns as wide as a voxel and as many as needed."""
    width, depth = volume.shape[1], volume.shape[3]
    widest = max(width, depth)
    x, z = centres(width, volume)[:, None], centres(depth, volume)
    u = (x * math.cos(azimuth) - z * math.sin(azimuth)) * widest / 2
    margin = math.ceil((math.hypot(width, depth) - widest) / 2)
    # The nudge keeps a wall seen edge-on at 45°, where rounding decides the side, in one column.
    return (u + widest / 2 + margin + 1e-3).floor().long()


def _cast_back(volume: Tensor, columns: Tensor) -> Tensor:
    """Each place's value of the silhouette S at its column."""
    planes = volume.transpose(2, 3).flatten(1, 2)
    index = columns.flatten()
    silhouette = planes.new_zeros(len(volume), int(index.max()) + 1, volume.shape[2])
    everywhere = index[:, None].expand_as(planes)
    silhouette = silhouette.scatter_reduce(1, everywhere, planes, "amax", include_self=False)
    return silhouette[:, index].unflatten(1, columns.shape).transpose(2, 3)
