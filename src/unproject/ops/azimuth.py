"""Rays of an orthographic camera at elevation 0: the fast path of silhouettes.

Such a ray stays at its height, and its samples are the same sparse matrix A (four bilinear weights a row) at every
height. With the volume as a table of columns V, one row for each place (x, z) and one column for each height, the
samples are A V, a gather of four rows each. The gradient is Aᵀ g, again a gather, since only the few samples around a
voxel depend on it. `resampling` is the plain reference with the same values.
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
    """The rays in one plane of (X, Z) voxels: `size` pixels, each with `samples` samples, nearest first.

    The plane is [-1, 1]², or [-extent, extent] in x and z each. `viewport` is half the width that the pixels see, one
    for all or (B,), and `offset` (B,) the middle of it.
    """

    azimuth: Tensor
    plane: tuple[int, int]
    size: int
    viewport: float | Tensor
    samples: int
    half_depth: float
    extent: tuple[float, float] = (1.0, 1.0)
    offset: Tensor | None = None

    def forward(self) -> Gather:
        """Return A: each sample, (B size samples) rows, gathers the four places around it."""
        c, s = (value[:, None, None] for value in cos_sin(self.azimuth))
        of_column, of_sample = self._positions(self._range(self.size)[:, None], self._range(self.samples), c, s)
        x, x_weight = _neighbours(of_column[0] + of_sample[0], self.plane[0])
        z, z_weight = _neighbours(of_column[1] + of_sample[1], self.plane[1])
        batch = torch.arange(len(c), dtype=torch.int32, device=c.device)[:, None, None]
        z = (z * len(c) + batch) * self.plane[0]
        return _gather(z[None, :] + x[:, None], z_weight[None, :] * x_weight[:, None])

    def adjoint(self, summed: bool = False) -> Gather:
        """Return Aᵀ: each place, (Z B X) rows, gathers the samples within one voxel; if `summed`, their pixels."""
        c, s = (value[:, None] for value in cos_sin(self.azimuth))
        x, z = self._range(self.plane[0]), self._range(self.plane[1])[:, None, None]
        column, sample = self._nearby(x, z, c, s)
        (x_u, z_u), (x_w, z_w) = self._positions(column, sample, c, s)
        # A sample that does not exist is infinitely far.
        x_u = (x_u - x).masked_fill_((column < 0) | (column >= self.size), math.inf)
        x_w.masked_fill_((sample < 0) | (sample >= self.samples), math.inf)
        weight = _hat(x_u[:, None] + x_w[None, :])
        weight *= _hat((z_u - z)[:, None] + z_w[None, :])
        batch = torch.arange(len(c), dtype=torch.int32, device=c.device)[:, None]
        column = _index(column, self.size) + batch * self.size
        if summed:
            return _gather(column[:, None].expand(weight.shape), weight)
        return _gather((column * self.samples)[:, None] + _index(sample, self.samples)[None, :], weight)

    def _positions(self, column: Tensor, sample: Tensor, c: Tensor, s: Tensor) -> tuple[tuple[Tensor, Tensor], ...]:
        """Return fractional voxel indices (x, z) of samples as two summands, one of the pixel and one of the sample."""
        (width, depth), (half_width, half_length) = self.plane, self.extent
        u = _per_item(self.viewport, c) * ((column * 2 + 1 - self.size) / self.size) + self._offset(c)
        w = -self.half_depth * ((sample * 2 + 1 - self.samples) / self.samples)
        of_column = ((u * c / half_width + 1) * width - 1) / 2, ((1 - u * s / half_length) * depth - 1) / 2
        return of_column, (w * s / half_width * width / 2, w * c / half_length * depth / 2)

    def _nearby(self, x: Tensor, z: Tensor, c: Tensor, s: Tensor) -> tuple[Tensor, Tensor]:
        """Return pixels, and samples, (n, Z, B, X), of a lattice that covers ±1 voxel, rotated, around each place."""
        (width, depth), (half_width, half_length) = self.plane, self.extent
        x, z = half_width * ((x * 2 + 1) / width - 1), half_length * ((z * 2 + 1) / depth - 1)
        reach = 2 * math.sqrt(2) / min(width / half_width, depth / half_length)
        viewport = _per_item(self.viewport, c)
        least = float(torch.as_tensor(self.viewport).nan_to_num(math.inf).min())
        column = _around((x * c - z * s - self._offset(c)) / viewport, reach / least, self.size)
        sample = _around(-(x * s + z * c) / self.half_depth, reach / self.half_depth, self.samples)
        return column, sample

    def _offset(self, like: Tensor) -> Tensor | float:
        return 0.0 if self.offset is None else _per_item(self.offset, like)

    def _range(self, count: int) -> Tensor:
        return torch.arange(count, dtype=self.azimuth.dtype, device=self.azimuth.device)


def _per_item(value: float | Tensor, like: Tensor) -> Any:
    """Return one value for all as it is, and values (B,) in the shape (B, 1, ...) of `like`."""
    return value.view_as(like) if isinstance(value, Tensor) else value


def _gather(row: Tensor, weight: Tensor) -> Gather:
    """Reorder from (n, m, …), which is fast to compute, to (…, n m), which gathers need."""
    taps = row.shape[0] * row.shape[1]
    return Gather(*(value.reshape(taps, -1).t().contiguous() for value in (row, weight)))


def _hat(distance: Tensor) -> Tensor:
    """Compute max(0, 1 - |distance|) in place, to save memory."""
    return distance.abs_().neg_().add_(1).clamp_(min=0)


def _neighbours(position: Tensor, count: int) -> tuple[Tensor, Tensor]:
    """Return the two cells around `position` and their linear weights, (2, ...); 0 for a cell outside the volume."""
    first = position.floor()
    cells = torch.stack((first, first + 1))
    weights = torch.stack((first + 1 - position, position - first))
    weights.masked_fill_((cells < 0) | (cells >= count), 0)
    return _index(cells, count), weights


def _index(cells: Tensor, count: int) -> Tensor:
    """Return cells within the volume, in place; one that is NaN, whose weight is NaN too, becomes the first."""
    return cells.clamp_(0, count - 1).nan_to_num_(0).int()


def _around(position: Tensor, reach: float, count: int) -> Tensor:
    """Return indices (n, ...) of the cells of [-1, 1] whose centres may lie within `reach` of `position`."""
    reach = reach * count / 2 + 1e-3
    first = (((position + 1) * count - 1) / 2 - reach).ceil()
    return torch.stack([first + k for k in range(math.floor(2 * reach) + 1)])


def ray_samples(volume: Tensor, rays: PlaneRays) -> Tensor:
    """Return the samples of all rays, (B, size, samples, Y), of `volume` (B, X, Y, Z)."""
    return multiply(volume, rays.forward(), rays.adjoint).view(len(volume), rays.size, rays.samples, -1)


def ray_sums(volume: Tensor, rays: PlaneRays) -> Tensor:
    """Return the sum over each ray, (B, size, Y), without storing the samples."""
    matrix = Gather(*(part.view(-1, 4 * rays.samples) for part in rays.forward()))
    return multiply(volume, matrix, lambda: rays.adjoint(summed=True)).view(len(volume), rays.size, -1)


def multiply(volume: Tensor, matrix: Gather, adjoint: Callable[[], Gather]) -> Tensor:
    """Return A V for `volume` (B, X, Y, Z): a row of Y values for each row of A. `adjoint` makes Aᵀ.

    Differentiable in the volume, and once in the weights of A.
    """
    return _Multiply.apply(_columns(volume), *matrix, adjoint)


def resample_heights(volume: Tensor, size: int, viewport: float | Tensor, offset: Tensor | None = None) -> Tensor:
    """Interpolate linearly along y to `size` heights, the pixel centres of offset ± viewport; zero outside.

    Args:
        viewport: half the height that is seen, one for all or (B,).
        offset: (B,), the middle of it (default: 0).
    """
    count = volume.shape[2]
    if not isinstance(viewport, Tensor) and viewport == 1 and offset is None and size == count:
        return volume
    height = centres(size, volume)
    height = (viewport[:, None] if isinstance(viewport, Tensor) else viewport) * height
    height = height if offset is None else height + offset[:, None]
    weight = _hat((((height + 1) * count - 1) / 2)[..., None] - torch.arange(count, device=volume.device))
    return torch.einsum("bxyz,bhy->bxhz" if weight.dim() == 3 else "bxyz,hy->bxhz", volume, weight)


def _columns(volume: Tensor) -> Tensor:
    """Return the table of columns, (Z B X, Y): whole rows are copied of volumes whose heights lie side by side."""
    return volume.permute(3, 0, 1, 2).reshape(-1, volume.shape[2])


class _Multiply(torch.autograd.Function):
    """A V by gathering rows, and its gradient Aᵀ g likewise: no sum depends on the order of threads."""

    @staticmethod
    def forward(ctx: Any, table: Tensor, index: Tensor, weight: Tensor, adjoint: Callable[[], Gather]) -> Tensor:
        ctx.index, ctx.adjoint = index, adjoint
        ctx.save_for_backward(weight, *([table] if weight.requires_grad else []))
        return _multiply(table, index, weight)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, None, Tensor | None, None]:
        (weight, *table), of_table, of_weight = ctx.saved_tensors, None, None
        if ctx.needs_input_grad[0]:
            matrix = Gather(ctx.index, weight)
            of_table = _Multiply.apply(gradient.contiguous(), *ctx.adjoint(), lambda: matrix)
        if ctx.needs_input_grad[2]:
            of_weight = _weight_gradient(table[0], ctx.index, weight, gradient)
        return of_table, None, of_weight, None


def _multiply(table: Tensor, index: Tensor, weight: Tensor) -> Tensor:
    return F.embedding_bag(index, table, per_sample_weights=weight.to(table), mode="sum")


def _weight_gradient(table: Tensor, index: Tensor, weight: Tensor, gradient: Tensor) -> Tensor:
    """Return ⟨V_index, g⟩ of each entry of A. PyTorch raises an error where its gradient is asked for in turn."""
    again = torch.is_grad_enabled()
    with torch.enable_grad():
        weight = weight if again else weight.detach().requires_grad_()
        product = _multiply(table, index, weight)
    return torch.autograd.grad(product, weight, gradient, create_graph=again)[0]
