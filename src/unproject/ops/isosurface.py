"""The surface {x : v(x) = level} of a volume as a closed triangle mesh.

The volume is taken as zero outside its box, so the surface is closed even where the shape touches the box.
Voxel i of N has its centre at (i + 1/2)/N·2 - 1: a solid block of voxels gets the extents of its voxels.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import ArrayLike
from scipy import ndimage, sparse
from skimage.measure import marching_cubes
from torch import Tensor

from unproject._types import UserError
from unproject.ops.parts import number_parts

# Closer to the level than this, marching cubes puts several vertices on one point and the mesh stops being a manifold.
# Cutting half a clearance lower also breaks the ties of binary volumes: voxels that touch in an edge alone are joined.
_CLEARANCE = 1e-3
# Taubin (1995), "A signal processing approach to fair surface design": shrink by λ, grow by μ, with 1/λ - 1/μ = 0.1.
_TAUBIN = (0.5, 1 / (1 / 0.5 - 0.1))


def isosurface(
    volume: ArrayLike, level: float = 0.5, *, smooth: int = 0, largest: bool = False, min_fraction: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Extract the surface by marching cubes (Lewiner) on the zero-padded volume, normals outwards.

    Args:
        volume: (X, Y, Z) array or tensor, occupancy in [0, 1].
        level: the occupancy on the surface, in [0.01, 0.99].
        smooth: rounds of Taubin's smoothing, which removes the steps of the voxels and keeps the topology, and
            thickness, even of what is one voxel thick.
        largest, min_fraction: see `without_floaters`; the same is true of the parts of the surface, by the volumes that
            they enclose: voxels that share an edge or a corner may lie on surfaces apart. Cavities are closed then.

    Returns:
        vertices (V, 3) float32 in the frame of the volume, [-1, 1]³, and faces (F, 3) int64, counter-clockwise
        seen from outside. Both are empty if nothing is above the level.

    Raises:
        UserError: not three axes, values that are not finite, or a level outside its range.

    Examples:
        >>> import numpy as np
        >>> volume = np.zeros((8, 8, 8))
        >>> volume[2:6, 2:6, 2:6] = 1  # a cube of half the side
        >>> vertices, faces = isosurface(volume)
        >>> vertices.min().round(2), vertices.max().round(2), faces.shape[1]
        (np.float32(-0.5), np.float32(0.5), 3)
    """
    v = without_floaters(_checked(volume, level), level, largest=largest, min_fraction=min_fraction)
    if not (v > level).any():
        return np.zeros((0, 3), np.float32), np.zeros((0, 3), np.int64)
    clear = np.where(v > level, np.maximum(v, level + _CLEARANCE), np.minimum(v, level - _CLEARANCE))
    # "ascent" is what makes the faces counter-clockwise from outside for a solid brighter than its surroundings.
    indices, faces, _, _ = marching_cubes(np.pad(clear, 1), level - _CLEARANCE / 2, gradient_direction="ascent")
    if largest or min_fraction:
        indices, faces = _parts_kept(indices, faces, 1.0 if largest else min_fraction)
    vertices = (indices - 0.5) / np.array(v.shape) * 2 - 1
    # Smoothing rounds edges, and the faces beside them swell by a tenth of a voxel.
    return _smoothed(vertices, faces, smooth).clip(-1, 1).astype(np.float32), faces.astype(np.int64)


def without_floaters(
    volume: ArrayLike, level: float = 0.5, *, largest: bool = False, min_fraction: float = 0.0
) -> np.ndarray:
    """Return the volume without small disconnected parts.

    Parts are the 26-connected components of {v > level}: voxels that share a corner are connected. Those with
    fewer than `min_fraction` of the voxels of the largest are set to zero, and all but the largest if `largest`.
    """
    v = _array(volume)
    parts, voxels = number_parts(v > level)
    if len(voxels) <= 2:
        return v
    dropped = voxels < min_fraction * voxels.max()
    if largest:
        dropped = np.arange(len(voxels)) != voxels.argmax()
    dropped[0] = False
    return np.where(dropped[parts], 0, v)


def _parts_kept(vertices: np.ndarray, faces: np.ndarray, fraction: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the parts of a surface that enclose at least a fraction of what the largest encloses.

    The volume of a closed surface is the sum of the tetrahedra of its faces and any point, a × b · c / 6; that of a
    cavity is negative.
    """
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    graph = sparse.coo_array((np.ones(len(edges), bool), edges.T), (len(vertices),) * 2)
    count, of_vertex = sparse.csgraph.connected_components(graph, directed=False)
    if count == 1:
        return vertices, faces
    a, b, c = (vertices[faces] - vertices.mean(0)).swapaxes(0, 1)
    volumes = np.bincount(of_vertex[faces[:, 0]], (np.cross(a, b) * c).sum(1), count)
    kept = volumes >= fraction * volumes.max()
    if fraction >= 1:  # one of several that are as large
        kept = np.arange(count) == volumes.argmax()
    kept = kept[of_vertex]
    numbers = np.cumsum(kept) - 1
    return vertices[kept], numbers[faces[kept[faces[:, 0]]]]


def without_cavities(volume: ArrayLike, level: float = 0.5) -> np.ndarray:
    """Return the volume with its cavities, which are not connected to the outside, filled."""
    v = _array(volume)
    hidden = ndimage.binary_fill_holes(v > level) & (v <= level)
    return np.where(hidden, 1, v)


def _array(volume: ArrayLike) -> np.ndarray:
    """Return an array, or that of a tensor on any device, of any precision, with a gradient or none."""
    if not isinstance(volume, Tensor):
        return np.asarray(volume)
    volume = volume.detach().cpu()
    return (volume.float() if volume.dtype == torch.bfloat16 else volume).numpy()  # NumPy has no bfloat16


def _checked(volume: ArrayLike, level: float) -> np.ndarray:
    v = _array(volume).astype(np.float32, copy=False)
    if v.ndim != 3:
        raise UserError(f"a volume has three axes, this array has shape {v.shape}: pass one shape at a time")
    if not np.isfinite(v).all():
        raise UserError("the volume holds NaN or infinity: its run has diverged, use an earlier checkpoint")
    if not 0.01 <= level <= 0.99:
        raise UserError(f"level {level} is not between 0.01 and 0.99: use 0.5 for the middle of the surface")
    return v


def _smoothed(vertices: np.ndarray, faces: np.ndarray, rounds: int) -> np.ndarray:
    """x ← x + λ L x, x ← x - μ L x, so many times, with L = mean of the neighbours - x; then thin parts are restored.

    Around a leg one voxel thick the surface itself is of the frequencies that are removed: six rounds leave half its
    width. All of it moves inwards then, while steps move inwards and outwards in turn. So each vertex moves back along
    its normal n by the mean of n · (x₀ - x) around it, as many times a mean of neighbours as x was moved.
    """
    if rounds == 0:
        return vertices
    import trimesh  # here, since it takes a second to import

    mesh = trimesh.Trimesh(vertices, faces, process=False)
    shrink, grow = _TAUBIN
    mean = trimesh.smoothing.laplacian_calculation(mesh)
    trimesh.smoothing.filter_taubin(mesh, shrink, grow, iterations=2 * rounds, laplacian_operator=mean)
    smoothed, normals = np.asarray(mesh.vertices), np.asarray(mesh.vertex_normals)
    inwards = ((vertices - smoothed) * normals).sum(1)
    for _ in range(2 * rounds):
        inwards = mean @ inwards
    return smoothed + normals * inwards[:, None]
