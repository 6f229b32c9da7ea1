"""Rays of an orthographic camera at any elevation: the fast path of tilted silhouettes.

Such a ray stays in the vertical plane of its pixel's column. `side_slices` resamples the volume into these planes, and
in a plane, of height h and depth t (towards the camera), the ray of pixel v is

    h cos e - t sin e = v

the same in every plane. `slice_samples` interpolates the samples of the reference in the planes (bilinearly: with
`side_slices` two interpolations where the reference has one). `slice_sums` is Joseph's line integral, faster: the ray
is sampled where it crosses the heights or the depths of the plane's grid, whichever it crosses at more, and each sample
is interpolated linearly along the other. A cell at the distance d of the ray then has the weight max(0, 1 - |d| / m),
where m = max(|cos e| Δh, |sin e| Δt), so the sums are continuous in e.

References:
    P. M. Joseph, An improved algorithm for reprojecting rays through pixel images, IEEE TMI 1982.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .azimuth import Gather, PlaneRays, multiply, ray_samples
from .rotation import cos_sin


def side_slices(volume: Tensor, azimuth: Tensor, size: int, viewport: float, depths: int, half_depth: float) -> Tensor:
    """Resample a volume (B, X, Y, Z) into the vertical planes of the pixels' columns: (B, depths, size, Y).

    Depths come nearest first and columns from right to left: they are the samples of a camera on the picture's right.
    """
    plane = (volume.shape[1], volume.shape[3])
    return ray_samples(volume, PlaneRays(azimuth + math.pi / 2, plane, depths, half_depth, size, viewport))


def slice_samples(
    slices: Tensor, elevation: Tensor, size: int, viewport: float, samples: int, half_depth: float
) -> Tensor:
    """Return samples along the rays at `elevation` (B,), (B, size, samples, columns), nearest first, lowest ray first.

    Differentiable in the slices and, once, in the elevation.
    """
    plane, extent = (slices.shape[1], slices.shape[3]), (half_depth, 1.0)
    return ray_samples(slices, PlaneRays(elevation - math.pi / 2, plane, size, viewport, samples, half_depth, extent))


def slice_sums(slices: Tensor, elevation: Tensor, size: int, viewport: float, half_depth: float) -> Tensor:
    """Return line integrals along the rays, (B, size, columns), in units of Δt, so of a level ray the sum of samples.

    Differentiable in the slices and, once, in the elevation.
    """
    lines = SliceLines(elevation, (slices.shape[1], slices.shape[3]), size, viewport, half_depth)
    sums = multiply(slices, lines.forward(), lines.adjoint).view(len(slices), size, -1)
    return sums * lines.step()[:, None, None]


@dataclass(frozen=True)
class SliceLines:
    """Joseph's rays at `elevation` (B,) in planes of (depths, heights) cells, [-half_depth, half_depth] × [-1, 1]."""

    elevation: Tensor
    plane: tuple[int, int]
    size: int
    viewport: float
    half_depth: float

    def step(self) -> Tensor:
        """Return the length of a ray, in units of Δt, between two of its samples."""
        lead, steep = self._lead()
        ratio = self._pitches()[1] / self._pitches()[0]
        return torch.where(steep, lead.new_tensor(ratio), 1) / lead.abs()

    def forward(self) -> Gather:
        """Return A: each ray, (B size) rows, gathers two cells at each depth, or at each height if it is steep."""
        (c, s), (lead, steep) = cos_sin(self.elevation), self._lead()
        c, s, lead, steep = (value[:, None, None] for value in (c, s, lead, steep))
        depths, heights = self.plane
        n, v = self._range(max(self.plane)), self.viewport * self._centres(self._range(self.size), self.size)[:, None]
        h, t = self._centres(n, heights), -self.half_depth * self._centres(n, depths)
        crossed = torch.where(steep, (v - h * c) / self.half_depth, v + t * s) / lead
        position = ((crossed + 1) * torch.where(steep, depths, heights) - 1) / 2
        first = position.floor()
        cell = torch.cat((first, first + 1), -1)
        weight = torch.cat((first + 1 - position, position - first), -1)
        return self._gather(cell, n.repeat(2).expand_as(cell), weight, steep)

    def adjoint(self) -> Gather:
        """Return Aᵀ: each cell, (heights B depths) rows, gathers the rays nearer than m."""
        c, s = (value[:, None] for value in cos_sin(self.elevation))
        depths, heights = self.plane
        h = self._centres(self._range(heights), heights)[:, None, None]
        t = -self.half_depth * self._centres(self._range(depths), depths)
        scale = self.size / 2 / self.viewport
        ray = (h * c - t * s) * scale + (self.size - 1) / 2
        lead, steep = self._lead()
        of_depth, of_height = self._pitches()
        reach = (lead.abs() * torch.where(steep, lead.new_tensor(of_depth), of_height) * scale)[:, None]
        first = (ray - reach).floor() + 1
        rays = torch.stack([first + k for k in range(math.ceil(2 * max(self._pitches()) * scale - 1e-6))])
        weight = (1 - ((rays - ray) / reach).abs()).clamp(min=0)
        weight = weight.masked_fill((rays < 0) | (rays >= self.size), 0)
        index = rays.clamp_(0, self.size - 1).int() + self._batch()[:, None] * self.size
        return Gather(*(value.view(len(rays), -1).t().contiguous() for value in (index, weight)))

    def _gather(self, cell: Tensor, n: Tensor, weight: Tensor, steep: Tensor) -> Gather:
        depth, height = torch.where(steep, cell, n), torch.where(steep, n, cell)
        outside = (depth < 0) | (depth >= self.plane[0]) | (height < 0) | (height >= self.plane[1])
        depth, height = depth.clamp(0, self.plane[0] - 1).int(), height.clamp(0, self.plane[1] - 1).int()
        index = (height * len(cell) + self._batch()[:, None, None]) * self.plane[0] + depth
        return Gather(*(value.flatten(0, 1) for value in (index, weight.masked_fill(outside, 0))))

    def _lead(self) -> tuple[Tensor, Tensor]:
        """Return the direction's component along the axis that a ray crosses at more cells, and if this is height."""
        c, s = cos_sin(self.elevation)
        steep = s.abs() * self._pitches()[0] > c.abs() * self._pitches()[1]
        return torch.where(steep, s, c), steep

    def _pitches(self) -> tuple[float, float]:
        return 2 * self.half_depth / self.plane[0], 2 / self.plane[1]

    def _centres(self, index: Tensor, count: int) -> Tensor:
        return (index * 2 + 1 - count) / count

    def _range(self, count: int) -> Tensor:
        return torch.arange(count, dtype=self.elevation.dtype, device=self.elevation.device)

    def _batch(self) -> Tensor:
        return torch.arange(len(self.elevation), dtype=torch.int32, device=self.elevation.device)
