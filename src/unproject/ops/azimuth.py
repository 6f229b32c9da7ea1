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

    def forward(self) -> Gather:
        """A: each sample, (B size samples) rows, gathers the four places around it."""
        (x_u, z_u), (x_w, z_w) = self._positions(self._range(self.size), self._range(self.samples))
        x, z = x_u[:, :, None] + x_w[:, None, :], z_u[:, :, None] + z_w[:, None, :]
        (xs, x_weight), (zs, z_weight) = _neighbours(x, self.plane[0]), _neighbours(z, self.plane[1])
        weight = x_weight[..., :, None] * z_weight[..., None, :]
        return Gather(self._index(xs, zs, self.plane), weight.view(-1, 4))

    def adjoint(self) -> Gather:
        """Aᵀ: each place, (B X Z) rows, gathers the samples within one voxel of it."""
        column, sample = self._nearby()
        (x_u, z_u), (x_w, z_w) = self._positions(column, sample)
        x, z = (self._range(count) for count in self.plane)
        # A sample that does not exist is infinitely far.
        x_u = (x_u - x[:, None, None]).masked_fill_((column < 0) | (column >= self.size), math.inf)
        x_w = x_w.masked_fill_((sample < 0) | (sample >= self.samples), math.inf)
        weight = _hat(x_u[..., :, None] + x_w[..., None, :])
        weight *= _hat((z_u - z[:, None])[..., :, None] + z_w[..., None, :])
        column, sample = column.clamp(0, self.size - 1), sample.clamp(0, self.samples - 1)
        index = self._index(column, sample, (self.size, self.samples))
        return Gather(index, weight.view(index.shape))

    def _positions(self, column: Tensor, sample: Tensor) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
        """Fractional voxel indices (x, z) = (x_u + x_w, z_u + z_w): the parts due to the column and to the sample."""
        (width, depth) = self.plane
        u = self.viewport * ((column * 2 + 1 - self.size) / self.size)
        w = -self.half_depth * ((sample * 2 + 1 - self.samples) / self.samples)
        (c_u, s_u), (c_w, s_w) = self._cos_sin(u), self._cos_sin(w)
        of_column = ((u * c_u + 1) * width - 1) / 2, ((1 - u * s_u) * depth - 1) / 2
        return of_column, (w * s_w * width / 2, w * c_w * depth / 2)

    def _nearby(self) -> tuple[Tensor, Tensor]:
        """(B, X, Z, n): columns, and samples, of a lattice that covers the turned ±1 voxel around each place."""
        x = ((self._range(self.plane[0]) * 2 + 1) / self.plane[0] - 1)[None, :, None]
        z = ((self._range(self.plane[1]) * 2 + 1) / self.plane[1] - 1)[None, None, :]
        c, s = (v[:, None, None] for v in cos_sin(self.azimuth))
        reach = 2 * math.sqrt(2) / min(self.plane)
        column = _around((x * c - z * s) / self.viewport, reach / self.viewport, self.size)
        sample = _around(-(x * s + z * c) / self.half_depth, reach / self.half_depth, self.samples)
        return column, sample

    def _cos_sin(self, like: Tensor) -> tuple[Tensor, Tensor]:
        c, s = cos_sin(self.azimuth)
        shape = (-1, *[1] * max(1, like.dim() - 1))
        return c.view(shape), s.view(shape)

    def _range(self, count: int) -> Tensor:
        return torch.arange(count, dtype=self.azimuth.dtype, device=self.azimuth.device)

    def _index(self, first: Tensor, second: Tensor, shape: tuple[int, int]) -> Tensor:
        """Row numbers in a (B shape[0] shape[1]) table, of all pairs of the last dimensions of `first` and `second`."""
        batch = torch.arange(len(self.azimuth), device=first.device).view(-1, *[1] * (first.dim() - 1))
        row = (batch * shape[0] + first.long()) * shape[1]
        index = row[..., :, None] + second.long()[..., None, :]
        return index.view(-1, first.shape[-1] * second.shape[-1])


def _hat(distance: Tensor) -> Tensor:
    """max(0, 1 - |distance|), in place: there are many of these."""
    return distance.abs_().neg_().add_(1).clamp_(min=0)


def _neighbours(position: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """(..., 2): the two cells around `position` and their linear weights, 0 for a cell that does not exist."""
    first = position.floor()
    cells = torch.stack((first, first + 1), -1)
    weights = torch.stack((first + 1 - position, position - first), -1)
    weights.masked_fill_((cells < 0) | (cells >= count), 0)
    return cells.clamp_(0, count - 1), weights


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
