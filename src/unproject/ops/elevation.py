"""Rays of an orthographic camera at any elevation: the fast path of tilted silhouettes.

Such a ray stays in the vertical plane of its pixel's column. `side_slices` resamples the volume into these planes, and
in a plane, of height h and depth t (towards the camera), the ray of pixel v is

    h cos e - t sin e = v

the same in every plane: the samples of a level camera turned by e, of a volume on its side. `slice_values` interpolates
them bilinearly: with `side_slices` these are two interpolations where the reference has one.
"""

from __future__ import annotations

import math

from torch import Tensor

from .azimuth import PlaneRays
from .ray_rules import RayRule, ray_values


def side_slices(volume: Tensor, azimuth: Tensor, size: int, viewport: float, depths: int, half_depth: float) -> Tensor:
    """Resample a volume (B, X, Y, Z) into the vertical planes of the pixels' columns: (B, depths, size, Y).

    Depths come nearest first and columns from right to left: they are the samples of a camera on the picture's right.
    """
    plane = (volume.shape[1], volume.shape[3])
    rays = PlaneRays(azimuth + math.pi / 2, plane, depths, half_depth, size, viewport)
    return ray_values(volume, rays, "samples")


def slice_values(
    slices: Tensor, elevation: Tensor, size: int, viewport: float, samples: int, half_depth: float, rule: RayRule
) -> Tensor:
    """Return `ray_rules.ray_values` along the rays at `elevation` (B,), (B, size, columns), lowest ray first.

    Samples of "samples" (B, size, samples, columns) come nearest first. Differentiable as `ray_values`, the elevation
    in place of the azimuth.
    """
    plane, extent = (slices.shape[1], slices.shape[3]), (half_depth, 1.0)
    rays = PlaneRays(elevation - math.pi / 2, plane, size, viewport, samples, half_depth, extent)
    return ray_values(slices, rays, rule)
