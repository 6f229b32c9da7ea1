"""The fast path for elevation 0: rays of a level orthographic camera, one horizontal plane for all heights.

Such a ray stays at its height, and the samples of a ray are the same sparse matrix A (four bilinear weights
a row) for every height. With the volume as a table of columns V (one row a place (x, z), one column a height),
the samples are A V, a gather of four rows each; the gradient is Aᵀ g, again a gather, because a voxel is
touched only by the few samples around it. `resampling` is the plain reference that this must equal.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from .resampling import centres
from .rotation import cos_sin


class Gather(NamedTuple):
    """A sparse matrix by rows: row r is Σ_t weight[r, t] e_index[r, t]."""

    index: Tensor
    weight: Tensor


@dataclass(frozen=True)
class PlaneRays:
    """The rays of one horizontal plane of (X, Z) voxels: `size` columns of `samples` samples, nearest first."""

    azimuth: Tensor
    plane: tuple[int, int]
    size: int
    viewport: float
    samples: int
    half_depth: float

    def positions(self, column: Tensor, sample: Tensor) -> tuple[Tensor, Tensor]:
        """Fractional voxel indices (x, z) of the given samples of the given columns."""
        c, s = (v.view(-1, *[1] * (column.dim() - 1)) for v in cos_sin(self.azimuth))
        u = self.viewport * ((column * 2 + 1 - self.size) / self.size)
        w = -self.half_depth * ((sample * 2 + 1 - self.samples) / self.samples)
        return ((u * c + w * s + 1) * self.plane[0] - 1) / 2, ((w * c - u * s + 1) * self.plane[1] - 1) / 2

    def forward(self) -> Gather:
        """A: each sample, (B size samples) rows, gathers the four places around it."""
        column, sample = self._lattice(self.size, self.samples)
        x, z = self.positions(column, sample)
        first = (x.floor(), z.floor())
        corners = torch.tensor([(0, 0), (0, 1), (1, 0), (1, 1)], device=x.device)
        xs, zs = first[0][..., None] + corners[:, 0], first[1][..., None] + corners[:, 1]
        weight = _hat(x[..., None] - xs) * _hat(z[..., None] - zs)
        return self._rows(xs, zs, self.plane, weight)

    def adjoint(self) -> Gather:
        """Aᵀ: each place, (B X Z) rows, gathers the samples within one voxel of it."""
        x, z = self._lattice(*self.plane)
        column, sample = self._nearby(x, z)
        at_x, at_z = self.positions(column, sample)
        weight = _hat(at_x - x[..., None]) * _hat(at_z - z[..., None])
        return self._rows(column, sample, (self.size, self.samples), weight)

    def _nearby(self, x: Tensor, z: Tensor) -> tuple[Tensor, Tensor]:
        """A lattice of samples that covers the turned square of ±1 voxel around each place."""
        c, s = (v[:, None, None] for v in cos_sin(self.azimuth))
        across, along = (2 * x + 1) / self.plane[0] - 1, (2 * z + 1) / self.plane[1] - 1
        reach = 2 * math.sqrt(2) / min(self.plane)
        columns = _around((across * c - along * s) / self.viewport, reach / self.viewport, self.size)
        samples = _around(-(across * s + along * c) / self.half_depth, reach / self.half_depth, self.samples)
        column, sample = torch.broadcast_tensors(columns[..., :, None], samples[..., None, :])
        return column.flatten(-2), sample.flatten(-2)

    def _lattice(self, rows: int, columns: int) -> tuple[Tensor, Tensor]:
        like = self.azimuth
        row = torch.arange(rows, dtype=like.dtype, device=like.device).view(1, -1, 1)
        column = torch.arange(columns, dtype=like.dtype, device=like.device).view(1, 1, -1)
        first, second = torch.broadcast_tensors(row, column)
        shape = (len(like), rows, columns)
        return first.expand(shape), second.expand(shape)

    def _rows(self, first: Tensor, second: Tensor, shape: tuple[int, int], weight: Tensor) -> Gather:
        inside = (first >= 0) & (first < shape[0]) & (second >= 0) & (second < shape[1])
        batch = torch.arange(len(self.azimuth), device=first.device).view(-1, *[1] * (first.dim() - 1))
        index = batch * (shape[0] * shape[1]) + (first * shape[1] + second).long()
        taps = first.shape[-1]
        return Gather((index * inside).view(-1, taps), (weight * inside).view(-1, taps))


def _hat(distance: Tensor) -> Tensor:
    return (1 - distance.abs()).clamp(min=0)


def _around(position: Tensor, reach: float, count: int) -> Tensor:
    """Indices of the cells of [-1, 1] whose centres may lie within `reach` of `position`."""
    reach = reach * count / 2 + 1e-3
    first = (((position + 1) * count - 1) / 2 - reach).ceil()
    return first[..., None] + torch.arange(math.floor(2 * reach) + 1, device=position.device)


def ray_samples(volume: Tensor, rays: PlaneRays) -> Tensor:
    """(B, size, samples, Y): what every sample of every column meets at every height of `volume` (B, X, Y, Z)."""
    values = _Multiply.apply(_columns(volume), rays.forward(), rays.adjoint)
    return values.view(len(volume), rays.size, rays.samples, -1)


def ray_sums(volume: Tensor, rays: PlaneRays) -> Tensor:
    """(B, size, Y): the samples of each ray summed, without ever holding them."""

    def summed() -> Gather:
        index, weight = rays.forward()
        return Gather(index.view(-1, 4 * rays.samples), weight.view(-1, 4 * rays.samples))

    def spread() -> Gather:
        index, weight = rays.adjoint()
        return Gather(index // rays.samples, weight)

    return _Multiply.apply(_columns(volume), summed(), spread).view(len(volume), rays.size, -1)


def resample_heights(volume: Tensor, size: int, viewport: float) -> Tensor:
    """Linear interpolation along y to `size` heights at the pixel centres of [-viewport, viewport]; zero outside."""
    count = volume.shape[2]
    if viewport == 1 and size == count:
        return volume
    position = ((viewport * centres(size, volume) + 1) * count - 1) / 2
    weight = _hat(position[:, None] - torch.arange(count, device=volume.device))
    return torch.einsum("bxyz,hy->bxhz", volume, weight)


def _columns(volume: Tensor) -> Tensor:
    return volume.transpose(2, 3).reshape(-1, volume.shape[2])


class _Multiply(torch.autograd.Function):
    """A V by gathering rows; its gradient Aᵀ g likewise, so that no sum depends on an order of threads."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, matrix: Gather, adjoint: Callable[[], Gather]) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx.matrix, ctx.adjoint = matrix, adjoint
        return F.embedding_bag(matrix.index, table, per_sample_weights=matrix.weight.to(table), mode="sum")

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:  # pyright: ignore[reportIncompatibleMethodOverride]
        matrix = ctx.matrix
        return _Multiply.apply(gradient.contiguous(), ctx.adjoint(), lambda: matrix), None, None
