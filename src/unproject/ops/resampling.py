"""Trilinear sampling of volumes, the rays along which a camera samples them, and shares of intervals.

Rays come in picture order: (B, row, column, sample, 3), row 0 the top, samples from the nearest to the farthest.
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

HALF_DEPTH = 1.5
"""Rays are sampled from 1.5 in front of the object's centre to 1.5 behind it, as in the released code."""


def centres(count: int, like: Tensor) -> Tensor:
    """(count,) centres of equal cells of [-1, 1], with the dtype and device of `like`."""
    return (torch.arange(count, dtype=like.dtype, device=like.device) * 2 + 1 - count) / count


def interval_shares(source: Tensor, target: Tensor) -> Tensor:
    """(m, n): the share of target interval i, between edges i and i + 1, that lies in source interval j.

    Area averages of n values between the n + 1 rising edges `source` are `interval_shares(source, target) @ values`.
    """
    low, high = target[:-1, None], target[1:, None]
    shared = torch.minimum(high, source[1:]) - torch.maximum(low, source[:-1])
    return shared.clamp(min=0) / (high - low)


def depth_range(resolution: int, samples: int | None = None) -> tuple[int, float]:
    """(number of samples, half depth): by default one sample a voxel, at voxel centres when looking along an axis."""
    if samples is not None:
        return samples, HALF_DEPTH
    count = resolution + 2 * math.ceil((HALF_DEPTH - 1) * resolution / 2)
    return count, count / resolution


def sample_volume(x: Tensor, points: Tensor) -> Tensor:
    """x at `points` by trilinear interpolation between voxel centres; zero outside.

    Args:
        x: (B, X, Y, Z).
        points: (B, ..., 3) as (x, y, z) in [-1, 1]³.

    Returns:
        (B, ...).
    """
    grid = points.flip(-1).reshape(len(points), -1, 1, 1, 3)
    values = F.grid_sample(x.unsqueeze(1), grid.to(x), align_corners=False)
    return values.reshape(points.shape[:-1])


def orthographic_rays(frame: Tensor, size: int, viewport: float, samples: int, half_depth: float) -> Tensor:
    """Parallel rays p = v (i r + j u) + w d through the pixel centres (i, j) of [-1, 1]².

    Args:
        frame: (B, 3, 3) with rows r, u, d (`rotation.camera_frame`).
        size: pixels a side.
        viewport: v, half the width that is seen.
        samples: samples a ray, w at the centres of equal cells of [-half_depth, half_depth], nearest first.

    Returns:
        (B, size, size, samples, 3).
    """
    across, up, towards = _camera_coordinates(frame, size, viewport, samples, half_depth)
    points = torch.stack(torch.broadcast_tensors(across, up, towards), -1)
    return torch.einsum("hwsk,bkj->bhwsj", points, frame)


def perspective_rays(
    frame: Tensor, size: int, viewport: float, samples: int, half_depth: float, distance: float
) -> Tensor:
    """Rays of a pinhole at `distance` from the centre that sees ±viewport in the plane through the centre.

    p = v (1 - w / distance) (i r + j u) + w d: orthographic rays that converge. The field of view is
    2 atan(viewport / distance). Arguments and result are those of `orthographic_rays`.
    """
    across, up, towards = _camera_coordinates(frame, size, viewport, samples, half_depth)
    narrowing = 1 - towards / distance
    points = torch.stack(torch.broadcast_tensors(across * narrowing, up * narrowing, towards), -1)
    return torch.einsum("hwsk,bkj->bhwsj", points, frame)


def perspective_slant(like: Tensor, size: int, viewport: float, distance: float) -> Tensor:
    """(size, size): how much longer than its depth the way along each pinhole ray is."""
    slope = (viewport / distance * centres(size, like)).square()
    return (1 + slope[:, None] + slope).sqrt()


def _camera_coordinates(
    frame: Tensor, size: int, viewport: float, samples: int, half_depth: float
) -> tuple[Tensor, Tensor, Tensor]:
    pixel = viewport * centres(size, frame)
    depth = -half_depth * centres(samples, frame)
    return pixel[None, :, None], -pixel[:, None, None], depth[None, None, :]
