"""Distances between every member of one set and every member of another.

========================= ==================================================== ==========================
1 - IoU                   1 - |a ∩ b| / |a ∪ b|                                occupancy, any rank
Chamfer                   mean_p min_q |p - q|² + mean_q min_p |p - q|²         points on the surfaces
========================= ==================================================== ==========================
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor

from .._types import UserError

THRESHOLD = 0.5
COLUMNS = 1 << 14


def one_minus_iou(a: Tensor, b: Tensor) -> Tensor:
    """Compute D[i, j] = 1 - |a_i ∩ b_j| / |a_i ∪ b_j| of the occupied cells, those strictly above 0.5.

    The distance of two empty members is 0, of an empty and a non-empty one 1. Intersections are matrix products over
    blocks of cells, which limits memory, and exact up to 2²⁴ cells.

    Args:
        a: (Na, ...) volumes or silhouettes.
        b: (Nb, ...), members of the same shape.

    Returns:
        (Na, Nb).

    Raises:
        UserError: if a set is empty, holds NaN or infinity, or the members differ in shape.

    Examples:
        >>> import torch, unproject as up
        >>> a = torch.tensor([[1.0, 1.0, 0.0, 0.0]])
        >>> b = torch.tensor([[1.0, 1.0, 0.0, 0.0], [0.0, 1.0, 1.0, 0.0]])
        >>> up.metrics.one_minus_iou(a, b)
        tensor([[0.0000, 0.6667]])
    """
    check_set(a, "a")
    check_set(b, "b")
    if a.shape[1:] != b.shape[1:]:
        raise UserError(
            f"one_minus_iou: members of a are {tuple(a.shape[1:])} and of b {tuple(b.shape[1:])}; resample one set"
        )
    return _one_minus_iou(a.flatten(1), b.flatten(1).to(a.device))


def _one_minus_iou(a: Tensor, b: Tensor) -> Tensor:
    common = torch.zeros(len(a), len(b), device=a.device)
    in_a, in_b = torch.zeros(len(a), device=a.device), torch.zeros(len(b), device=a.device)
    for left, right in zip(a.split(COLUMNS, 1), b.split(COLUMNS, 1), strict=True):
        left, right = (left > THRESHOLD).float(), (right > THRESHOLD).float()
        common += left @ right.T
        in_a += left.sum(1)
        in_b += right.sum(1)
    union = in_a[:, None] + in_b[None] - common
    return (union - common) / union.clamp_min(1)


@torch.no_grad()
def chamfer(points_a: Tensor, points_b: Tensor) -> Tensor:
    """Compute D[i, j] = mean over p in a_i of min_q |p - q|² + mean over q in b_j of min_p |p - q|².

    The squared, two-sided form of Achlioptas et al., *Learning Representations and Generative Models for 3D Point
    Clouds*, ICML 2018 (as in PointFlow). |p - q|² is one matrix product of (-2p, |p|², 1) and (q, 1, |q|²), clamped at
    0; its rounding error is about 1e-6 for points in [-1, 1]³.

    Args:
        points_a: (Na, n, D) point sets.
        points_b: (Nb, m, D).

    Returns:
        (Na, Nb), in squared units of length; without gradients.

    Raises:
        UserError: if a set is empty, holds NaN or infinity, or the points differ in dimension.

    Examples:
        >>> import torch, unproject as up
        >>> points = torch.tensor([[[0.0, 0.0, 0.0]]])
        >>> up.metrics.chamfer(points, points + torch.tensor([1.0, 0.0, 0.0]))
        tensor([[2.]])
    """
    check_set(points_a, "points_a")
    check_set(points_b, "points_b")
    if points_a.ndim != 3 or points_b.ndim != 3 or points_a.shape[2] != points_b.shape[2]:
        raise UserError(
            f"chamfer: points are (sets, points, dimensions), not {tuple(points_a.shape)} and {tuple(points_b.shape)}"
        )
    left, right = _left_factor(points_a.float()), _right_factor(points_b.float().to(points_a.device))
    square = left.new_empty(left.shape[1], right.shape[2])
    with one_thread():
        return torch.stack([torch.stack([_chamfer_of_two(p, q, square) for q in right]) for p in left])


@contextmanager
def one_thread() -> Iterator[None]:
    """Run a block in one thread: for many small operations on a busy machine a second one may be 100 times slower."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)


def _left_factor(p: Tensor) -> Tensor:
    square = p.square().sum(-1, keepdim=True)
    return torch.cat([-2 * p, square, torch.ones_like(square)], -1)


def _right_factor(q: Tensor) -> Tensor:
    square = q.square().sum(-1, keepdim=True)
    return torch.cat([q, torch.ones_like(square), square], -1).transpose(1, 2).contiguous()


def _chamfer_of_two(p: Tensor, q: Tensor, square: Tensor) -> Tensor:
    torch.mm(p, q, out=square)
    return square.amin(1).clamp_min_(0).mean() + square.amin(0).clamp_min_(0).mean()


def surface_points(volumes: Tensor, n: int, rng: torch.Generator) -> Tensor:
    """Draw n points for each volume, uniform by area on the faces between occupied and empty voxels.

    These faces are the exact surface of the set of voxels above 0.5 in [-1, 1]³; outside the grid is empty. A volume
    without occupied voxels gives n points at the origin, so that the Chamfer distance of two empty ones is 0, like
    1 - IoU.

    Args:
        volumes: (B, N, N, N).
        n: points a volume.
        rng: the source of random draws.

    Returns:
        (B, n, 3) points (x, y, z).

    Raises:
        UserError: if there are no volumes, they are not cubes, or hold NaN or infinity.

    Examples:
        >>> import torch, unproject as up
        >>> points = up.metrics.surface_points(torch.ones(1, 8, 8, 8), 100, torch.Generator().manual_seed(0))
        >>> points.abs().amax(2).unique()  # on the faces of the box
        tensor([1.])
    """
    check_set(volumes, "volumes")
    if volumes.ndim != 4 or len(set(volumes.shape[1:])) != 1 or n < 1:
        raise UserError(f"surface_points: give (B, N, N, N) volumes and n >= 1, not {tuple(volumes.shape)}, n = {n}")
    with one_thread():
        return torch.stack([_points_on(volume > THRESHOLD, n, rng) for volume in volumes.cpu()])


def _points_on(occupied: Tensor, n: int, rng: torch.Generator) -> Tensor:
    faces = exposed_faces(occupied).nonzero()
    which = torch.randint(max(1, len(faces)), (n,), generator=rng)
    offset = torch.rand(n, 3, generator=rng)
    if len(faces) == 0:
        return torch.zeros(n, 3)
    axis, side, voxel = faces[which, 0], faces[which, 1], faces[which, 2:]
    offset[torch.arange(n), axis] = side.float()
    return (voxel + offset) / len(occupied) * 2 - 1


def exposed_faces(occupied: Tensor) -> Tensor:
    """Return F[axis, side, x, y, z]: voxel (x, y, z) is occupied and its neighbour below (0) or above (1) is not."""
    padded = torch.nn.functional.pad(occupied, (1,) * 6)
    inside = slice(1, -1)
    neighbours = [[padded.roll(shift, axis)[inside, inside, inside] for shift in (1, -1)] for axis in range(3)]
    return torch.stack([torch.stack([occupied & ~neighbour for neighbour in pair]) for pair in neighbours])


def check_set(items: Tensor, name: str) -> None:
    """Raise UserError unless a set has at least one member, of rank 1 or more, and is finite."""
    if items.ndim < 2 or items.numel() == 0:
        raise UserError(f"the set {name} of shape {tuple(items.shape)} is empty; give at least one item to score")
    if items.is_floating_point() and not items.isfinite().all():
        raise UserError(f"the set {name} holds NaN or infinity; check whether its run has diverged")
