"""Solid voxels of a triangle mesh, by winding numbers counted along the grid's own lines.

Along a line in direction d, every crossing of the surface changes the winding number by -sign(n·d), n being the outward
normal; a point is inside where it is not 0. A closed mesh gives the same number from all six directions. One with
holes or missing faces does not, and the median of the six decides: a ray that leaks through a hole is outvoted.
Unlike parity, windings add up where closed parts overlap, as they do in most artists' models.

What is thinner than a voxel covers less than half of any, and would vanish: legs, table tops, faces without thickness.
It becomes as thick as a voxel, or as two where it lies half in either.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from scipy.ndimage import binary_dilation

from ...ops.parts import joined_parts

SAMPLES = 3
"""Sample points per voxel and axis."""


def voxelise(vertices: np.ndarray, faces: np.ndarray, resolution: int) -> np.ndarray:
    """(R, R, R) uint8, 0 or 1: the voxels of [-1, 1]³ that are at least half inside the mesh or of thin parts.

    Of legs that are now thick, now thin, the voxels between are less than half covered: they join what lies near.
    """
    share = torch.from_numpy(coverage(vertices, faces, resolution))
    return (joined_parts(share) >= 0.5).numpy().astype(np.uint8)


def coverage(vertices: np.ndarray, faces: np.ndarray, resolution: int) -> np.ndarray:
    """(R, R, R) float32: the share of each voxel of [-1, 1]³ that is inside the mesh, 1 of thin parts."""
    fine = resolution * SAMPLES
    triangles = (vertices[faces].astype(np.float64) + 1) * fine / 2 - 0.5
    votes, touched = [], np.zeros((fine,) * 3, dtype=bool)
    for axis in range(3):
        changes, crossed = crossings(triangles, axis, fine)
        touched |= np.moveaxis(crossed, -1, axis)[:fine, :fine, :fine]
        forward = np.cumsum(changes, -1)
        votes += [np.moveaxis(w[..., :fine], -1, axis) for w in (forward, forward - forward[..., -1:])]
    inside = np.abs(np.median(np.stack(votes), axis=0)) > 0.5
    share = _pooled(inside.astype(np.float32), resolution)
    passes = (_pooled(touched.astype(np.float32), resolution) > 0) | _on_edges(triangles / SAMPLES, resolution)
    thin = thin_parts(share, passes)
    return np.where(thin, 1.0, share).astype(np.float32)


def thin_parts(share: np.ndarray, touched: np.ndarray) -> np.ndarray:
    """(R, R, R) bool: voxels of thin parts, of the covered `share` of each and whether the surface passes through it.

    Thick is what is at least half covered; the surface passes through its neighbours too. Thin is what it passes
    through elsewhere, and where that goes on to what is thick. How much of a voxel is covered does not count: of few
    sample points it is too uncertain, and slanting plates would be full of holes.
    """
    thick, around = share >= 0.5, np.ones((3, 3, 3))
    passed = touched & ~thick
    apart = passed & ~binary_dilation(thick, around)
    return passed & binary_dilation(apart, around)


def crossings(triangles: np.ndarray, axis: int, fine: int) -> tuple[np.ndarray, np.ndarray]:
    """(F, F, F + 1) changes of the winding number along `axis`, the other two axes first, and where there are any.

    Entry k is the change between the sample points k - 1 and k. Of both faces of a thin plate it is 0.
    """
    u, v = [a for a in range(3) if a != axis]
    # Lines pass a hair beside the sample points, so that none runs exactly through an edge shared by two triangles.
    p = triangles[:, :, [u, v]] + np.array([1.37e-5, 2.71e-5])
    area = _cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    upright = np.abs(area) > 1e-12
    p, depth, area = p[upright], triangles[upright][:, :, axis], area[upright]
    which, points = _grid_points(p, fine)
    q, t = p[which], points.astype(np.float64)
    weights = np.stack([_cross(q[:, (i + 2) % 3] - q[:, (i + 1) % 3], t - q[:, (i + 1) % 3]) for i in range(3)], 1)
    weights /= area[which, None]
    hit = (weights >= 0).all(1)
    level = np.ceil((weights[hit] * depth[which[hit]]).sum(1)).clip(0, fine).astype(np.int64)
    facing = np.sign(area[which[hit]]) * (-1 if axis == 1 else 1)
    changes = np.zeros((fine, fine, fine + 1), dtype=np.int16)
    place = points[hit, 0], points[hit, 1], level
    np.add.at(changes, place, -facing.astype(np.int16))
    crossed = np.zeros(changes.shape, dtype=bool)
    crossed[place] = True
    return changes, crossed


def _on_edges(triangles: np.ndarray, resolution: int) -> np.ndarray:
    """(R, R, R) bool: voxels that edges of triangles pass through, as the grid's lines may all miss a needle.

    Triangles are in voxels, 0 half a sample inside the first one. Points on edges are half a voxel apart.
    """
    found = np.zeros((resolution,) * 3, dtype=bool)
    for start, end in zip(triangles.swapaxes(0, 1), np.roll(triangles, -1, 1).swapaxes(0, 1), strict=True):
        count = np.ceil(2 * np.abs(end - start).max(1)).clip(1, 4 * resolution).astype(np.int64)
        which = np.repeat(np.arange(len(start)), count)
        part = (np.arange(len(which)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[which]
        place = start[which] + part[:, None] * (end - start)[which] + 0.5 / SAMPLES
        x, y, z = np.floor(place).astype(np.int64).T
        inside = (place >= 0).all(1) & (place < resolution).all(1)
        found[x[inside], y[inside], z[inside]] = True
    return found


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _grid_points(p: np.ndarray, fine: int) -> tuple[np.ndarray, np.ndarray]:
    """(which triangle, grid point) of all grid points inside the triangles' bounding boxes."""
    low = np.ceil(p.min(1)).clip(0, fine).astype(np.int64)
    size = (np.floor(p.max(1)).clip(-1, fine - 1).astype(np.int64) - low + 1).clip(min=0)
    count = size.prod(1)
    which = np.repeat(np.arange(len(p)), count)
    place = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    width = size[which, 1]
    return which, low[which] + np.stack([place // np.maximum(width, 1), place % np.maximum(width, 1)], 1)


def _pooled(fine: np.ndarray, resolution: int) -> np.ndarray:
    return fine.reshape(resolution, SAMPLES, resolution, SAMPLES, resolution, SAMPLES).mean((1, 3, 5))


def normalised(vertices: np.ndarray) -> np.ndarray:
    """Centre the bounding box and scale it: longest side 1.8, or less where the radius about y would pass 0.95."""
    low, high = vertices.min(0), vertices.max(0)
    centred = vertices - (low + high) / 2
    radius = np.hypot(centred[:, 0], centred[:, 2]).max()
    return centred * min(0.9 / max((high - low).max() / 2, 1e-12), 0.95 / max(radius, 1e-12))


def triangles_of(loaded: Any) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (V, 3) and faces (F, 3) of what trimesh loads, the meshes of a scene joined."""
    mesh = loaded.to_mesh() if hasattr(loaded, "to_mesh") else loaded
    faces = getattr(mesh, "faces", None)
    if faces is None or len(faces) == 0:
        raise ValueError("has no triangles")
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(faces)
