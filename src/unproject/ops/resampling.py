"""Trilinear sampling of volumes, the rays along which a camera samples them, and shares of intervals.

Rays are in picture order: (B, row, column, sample, 3), row 0 the top, samples from the nearest to the farthest.
"""

from __future__ import annotations

import math
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor

HALF_DEPTH = 1.5
"""Rays are sampled from 1.5 in front of the object's centre to 1.5 behind it, as in the released code."""


def centres(count: int, like: Tensor) -> Tensor:
    """Return the centres (count,) of equal cells of [-1, 1], with the dtype and device of `like`."""
    return (torch.arange(count, dtype=like.dtype, device=like.device) * 2 + 1 - count) / count


def in_single(x: Tensor) -> Tensor:
    """Return x in float32 if it is of half precision, which cannot place a sample; float64 stays."""
    return x.to(torch.promote_types(x.dtype, torch.float32))


def interval_shares(source: Tensor, target: Tensor) -> Tensor:
    """(m, n): the share of target interval i, between edges i and i + 1, that lies in source interval j.

    Area averages of n values between the n + 1 rising edges `source` are `interval_shares(source, target) @ values`.
    """
    low, high = target[:-1, None], target[1:, None]
    shared = torch.minimum(high, source[1:]) - torch.maximum(low, source[:-1])
    return shared.clamp(min=0) / (high - low)


def doubled(x: Tensor) -> Tensor:
    """Interpolate images (B, C, H, W) or lines (B, C, L) linearly to twice as many pixels a side.

    On a GPU by sums of neighbours: PyTorch's gradient adds in an order that differs from run to run there, and its
    kernels for lines took a third of the time of all.

    Examples:
        >>> import torch
        >>> from unproject.ops.resampling import doubled
        >>> doubled(torch.tensor([[[0.0, 4.0]]]))
        tensor([[[0., 1., 3., 4.]]])
    """
    if not x.is_cuda:
        return F.interpolate(x, scale_factor=2, mode="bilinear" if x.dim() == 4 else "linear", align_corners=False)
    for side in range(2, x.dim()):
        x = doubled_along(x, side)
    return x


def doubled_along(x: Tensor, side: int) -> Tensor:
    """Interpolate linearly along one side to twice as many pixels; the outermost continue to the border."""
    count = x.shape[side]
    before = torch.cat([x.narrow(side, 0, 1), x.narrow(side, 0, count - 1)], side)
    after = torch.cat([x.narrow(side, 1, count - 1), x.narrow(side, count - 1, 1)], side)
    pair = torch.stack((torch.lerp(x, before, 0.25), torch.lerp(x, after, 0.25)), side + 1)
    return pair.flatten(side, side + 1)


def sampled_pictures(images: Tensor, grid: Tensor) -> Tensor:
    """Interpolate images (B, C, H, W) bilinearly at places `grid` (B, h, w, 2), (x, y) in [-1, 1]; 0 outside.

    On a GPU the gradient by the images is added up in one order (`grid_sample`'s is not); there is none by the places.
    """
    return gathered_pictures(images, grid) if images.is_cuda else F.grid_sample(images, grid, align_corners=False)


def gathered_pictures(images: Tensor, grid: Tensor) -> Tensor:
    """Return the values of `sampled_pictures` as weighted sums of four pixels each."""
    height, width = images.shape[2:]
    x, y = (((grid[..., axis].detach() + 1) * side - 1) / 2 for axis, side in ((0, width), (1, height)))
    left, upper = x.floor(), y.floor()
    flat, total = images.flatten(2), torch.zeros((), device=images.device)
    for across, down in ((0, 0), (1, 0), (0, 1), (1, 1)):
        column, row = left + across, upper + down
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        weight = (1 - (x - column).abs()) * (1 - (y - row).abs()) * inside
        place = (row.clamp(0, height - 1) * width + column.clamp(0, width - 1)).long().flatten(1)
        total = total + _picked(flat, place).unflatten(2, grid.shape[1:3]) * weight[:, None]
    return total


def _picked(x: Tensor, place: Tensor) -> Tensor:
    """Return x[b, :, place[b, i]], (B, C, N), of (B, C, M) and (B, N)."""
    batch = torch.arange(len(x), device=x.device)[:, None]
    return x.transpose(1, 2)[batch, place].transpose(1, 2)


def depth_range(resolution: int, samples: int | None = None) -> tuple[int, float]:
    """Return the number of samples and half the depth (default: one sample a voxel, at voxel centres along an axis)."""
    if samples is not None:
        return samples, HALF_DEPTH
    count = resolution + 2 * math.ceil((HALF_DEPTH - 1) * resolution / 2)
    return count, count / resolution


def sample_volume(x: Tensor, points: Tensor) -> Tensor:
    """Interpolate x trilinearly between voxel centres at `points`; zero outside.

    Args:
        x: (B, X, Y, Z); of half precision, the values are float32.
        points: (B, ..., 3) as (x, y, z) in [-1, 1]³.

    Returns:
        (B, ...).

    Examples:
        >>> import torch, unproject as up
        >>> volume = torch.ones(1, 4, 4, 4)
        >>> up.ops.sample_volume(volume, torch.tensor([[[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]]))
        tensor([[1., 0.]])
    """
    x = in_single(x)
    grid = points.flip(-1).flatten(1, -2)[:, :, None, None]
    values = F.grid_sample(x.unsqueeze(1), grid.to(x), align_corners=False)
    return values.reshape(points.shape[:-1])


def orthographic_rays(frame: Tensor, size: int, viewport: float, samples: int, half_depth: float) -> Tensor:
    """Return parallel rays p = v (i r + j u) + w d through the pixel centres (i, j) of [-1, 1]².

    Args:
        frame: (B, 3, 3) with rows r, u, d (`rotation.camera_frame`).
        size: pixels a side.
        viewport: v, half the visible width.
        samples: samples a ray, w at the centres of equal cells of [-half_depth, half_depth], nearest first.

    Returns:
        (B, size, size, samples, 3).

    Examples:
        >>> import torch, unproject as up
        >>> rays = up.ops.orthographic_rays(up.ops.camera_frame(torch.zeros(2)), 8, 1.0, samples=12, half_depth=1.5)
        >>> rays.shape
        torch.Size([2, 8, 8, 12, 3])
    """
    across, up, towards = _camera_coordinates(frame, size, viewport, samples, half_depth)
    points = torch.stack(torch.broadcast_tensors(across, up, towards), -1)
    return torch.einsum("hwsk,bkj->bhwsj", points, frame)


def perspective_rays(
    frame: Tensor, size: int, viewport: float, samples: int, half_depth: float, distance: float
) -> Tensor:
    """Return rays of a pinhole at `distance` from the centre, with ±viewport visible in the plane through the centre.

    p = v (1 - w / distance) (i r + j u) + w d: orthographic rays that converge. The field of view is
    2 atan(viewport / distance). Arguments and result are those of `orthographic_rays`.

    Examples:
        >>> import torch, unproject as up
        >>> frame = up.ops.camera_frame(torch.zeros(2))
        >>> up.ops.perspective_rays(frame, 8, 1.0, samples=12, half_depth=1.5, distance=4.0).shape
        torch.Size([2, 8, 8, 12, 3])
    """
    across, up, towards = _camera_coordinates(frame, size, viewport, samples, half_depth)
    narrowing = 1 - towards / distance
    points = torch.stack(torch.broadcast_tensors(across * narrowing, up * narrowing, towards), -1)
    return torch.einsum("hwsk,bkj->bhwsj", points, frame)


def pinhole_rays(
    frame: Tensor,
    size: int,
    viewport: float | Tensor,
    perspective: Tensor,
    right: float | Tensor = 0.0,
    up: float | Tensor = 0.0,
) -> tuple[Tensor, Tensor]:
    """Return rays p = o + w c of a pinhole for each element, o = v (i r + j u) and c = d - o / distance.

    They are those of `perspective_rays`, at 0 of `orthographic_rays`; |c| is the ratio of length to depth.

    Args:
        frame: (B, 3, 3) with rows r, u, d (`rotation.camera_frame`).
        size: pixels a side.
        viewport: v, half the visible width of the plane through the centre, one for all or (B,).
        perspective: (B,), one over the distance of the pinhole from the centre.
        right, up: where the middle of the pixels is, one for all or (B,).

    Returns:
        o and c, (B, size, size, 3) each.

    Examples:
        >>> import torch, unproject as up
        >>> frame, distance = up.ops.camera_frame(torch.zeros(2)), torch.tensor([4.0, 8.0])
        >>> points = up.ops.ray_points(*up.ops.pinhole_rays(frame, 8, 1.0, 1 / distance), samples=12, half_depth=1.5)
        >>> torch.allclose(points[1], up.ops.perspective_rays(frame, 8, 1.0, 12, 1.5, 8.0)[1], atol=1e-6)
        True
    """
    r, u, d = (row[:, None, None] for row in frame.unbind(1))
    i, v = centres(size, frame)[:, None], _per_ray(viewport)
    origin = (v * i + _per_ray(right)) * r + (_per_ray(up) - v * i[:, None]) * u
    return origin, d - _per_ray(perspective) * origin


def ray_points(origin: Tensor, direction: Tensor, samples: int, half_depth: float) -> Tensor:
    """Return o + w c, (B, ..., samples, 3), for w at the centres of equal cells of ±half_depth, nearest first."""
    w = -half_depth * centres(samples, origin)[:, None]
    return origin.unsqueeze(-2) + w * direction.unsqueeze(-2)


def _per_ray(value: float | Tensor) -> Any:
    return value[:, None, None, None] if isinstance(value, Tensor) else value


def perspective_slant(like: Tensor, size: int, viewport: float, distance: float) -> Tensor:
    """Return the ratio (size, size) of length along each pinhole ray to depth."""
    slope = (viewport / distance * centres(size, like)).square()
    return (1 + slope[:, None] + slope).sqrt()


def _camera_coordinates(
    frame: Tensor, size: int, viewport: float, samples: int, half_depth: float
) -> tuple[Tensor, Tensor, Tensor]:
    pixel = viewport * centres(size, frame)
    depth = -half_depth * centres(samples, frame)
    return pixel[None, :, None], -pixel[:, None, None], depth[None, None, :]
