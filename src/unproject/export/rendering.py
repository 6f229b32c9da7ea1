"""Shaded orthographic views of volumes, in numpy alone: triangles in, z-buffer, clay out. No OpenGL, no window.

The picture shows the same surface that `meshes.glb` writes. Light is fixed to the camera, so that every view of a
turntable is lit alike; what shows a shape is soft shadow, occlusion in creases and a shadow on the floor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from unproject._types import UserError
from unproject.export._volumes import as_batch
from unproject.ops.isosurface import isosurface, without_cavities

_CLAY = np.array([0.70, 0.48, 0.36])
_KEY_LIGHT = np.array([-0.45, 0.75, 0.55]) / np.linalg.norm([-0.45, 0.75, 0.55])
ELEVATION = math.radians(20)


@dataclass(frozen=True)
class Solid:
    """A volume made ready for rendering from any direction: its surface, and how open the sky is at each vertex."""

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    openness: np.ndarray
    blurred: np.ndarray


def solid(volume: ArrayLike, level: float = 0.5, smooth: int = 6) -> Solid:
    """The surface of one (X, Y, Z) volume with smooth normals and ambient occlusion, computed once for all views."""
    v = np.clip(as_batch(volume)[0], 0, 1)
    vertices, faces = isosurface(without_cavities(v, level), level, smooth=smooth)
    normals = vertex_normals(vertices, faces)
    occupied = (v > level).astype(np.float32)
    blurred = ndimage.gaussian_filter(occupied, max(v.shape) / 40, mode="constant")
    return Solid(vertices, normals, faces, openness(occupied, vertices, normals), blurred)


def render_volume(
    volume: ArrayLike,
    azimuth: float,
    elevation: float = ELEVATION,
    size: int = 192,
    *,
    extent: float | None = None,
    level: float = 0.5,
) -> np.ndarray:
    """A (size, size, 3) uint8 picture of one (X, Y, Z) volume on white.

    Args:
        azimuth, elevation: of the camera, radians: it stands at (sin a cos e, sin e, cos a cos e).
        size: pixels.
        extent: half the width of the view in units of the volume; fitted to the shape over all azimuths if left out.
        level: the occupancy on the surface.
    """
    extent = fitted_extent(volume, elevation, level) if extent is None else extent
    return render(solid(volume, level), azimuth, elevation, size, extent)


def fitted_extent(volumes: ArrayLike, elevation: float = ELEVATION, level: float = 0.5) -> float:
    """Half the width of the smallest view that shows all the volumes whole at every azimuth, with a margin."""
    occupied = (as_batch(volumes) > level).any(0)
    if not occupied.any():
        return 1.0
    half_voxel = 1 / max(occupied.shape)
    reach = np.abs((np.argwhere(occupied) + 0.5) / np.array(occupied.shape) * 2 - 1) + half_voxel
    radius = np.hypot(reach[:, 0], reach[:, 2])
    height = reach[:, 1] * math.cos(elevation) + radius * abs(math.sin(elevation))
    return 1.06 * float(np.maximum(radius, height).max())


def render(shape: Solid, azimuth: float, elevation: float, size: int, extent: float) -> np.ndarray:
    """`render_volume` for a shape that is ready, supersampled 3 × 3."""
    if size < 8 or extent <= 0:
        raise UserError(f"a view of {size} pixels and half-width {extent}: use at least 8 pixels and a positive width")
    camera = camera_axes(azimuth, elevation)
    picture = _floor(shape, camera, size, extent)
    if len(shape.faces):
        picture = _over(picture, *_supersampled(shape, camera, size, extent))
    return (255 * np.clip(picture, 0, 1) ** (1 / 2.2)).round().astype(np.uint8)


def camera_axes(azimuth: float, elevation: float) -> np.ndarray:
    """Rows: the picture's right, its up, and the direction towards the camera."""
    a, e = azimuth, elevation
    right = [math.cos(a), 0, -math.sin(a)]
    up = [-math.sin(a) * math.sin(e), math.cos(e), -math.cos(a) * math.sin(e)]
    return np.array([right, up, [math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)]])


def rasterise(points: np.ndarray, faces: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which triangle each pixel's centre sees.

    Args:
        points: (V, 3) in the camera's frame: x right, y up in [-1, 1], z towards the camera.
        faces: (F, 3), counter-clockwise from outside; the others face away and are left out.

    Returns:
        seen (size, size) bool and, for the seen pixels in row order, the face (P,) and barycentric weights (P, 3).
    """
    pixels = np.stack([(points[:, 0] + 1) * size / 2 - 0.5, (1 - points[:, 1]) * size / 2 - 0.5], axis=1)
    a, b, c = pixels[faces].transpose(1, 0, 2)
    # Rows grow downwards, so a triangle that faces the camera has a negative doubled area.
    area = _cross(b - a, c - a)
    front = np.flatnonzero(area < -1e-9)
    face, column, row = _candidates(pixels[faces[front]], size)
    face = front[face]
    wa, wb = (_edge(o, q, area)[face] for o, q in ((b, c), (c, a)))
    wa, wb = (w[:, 0] * column + w[:, 1] * row + w[:, 2] for w in (wa, wb))
    inside = np.flatnonzero((wa >= -1e-9) & (wb >= -1e-9) & (wa + wb <= 1 + 1e-9))
    face, index, wa, wb = face[inside], (row * size + column)[inside], wa[inside], wb[inside]
    weights = np.stack([wa, wb, 1 - wa - wb], axis=1)
    depth = (weights * points[faces[face], 2]).sum(1)
    # Written from back to front, the last one stays: a z-buffer.
    order = np.argsort(depth)
    winner = np.full(size * size, -1)
    winner[index[order]] = order
    hit = winner[winner >= 0]
    return (winner >= 0).reshape(size, size), face[hit], weights[hit]


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Unit normals: the sum of the area-weighted normals of the faces around each vertex."""
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    face_normals = np.cross(b - a, c - a)
    summed = np.zeros_like(vertices)
    for i in range(3):
        np.add.at(summed, faces[:, i], face_normals)
    return summed / np.maximum(np.linalg.norm(summed, axis=1, keepdims=True), 1e-12)


def _supersampled(shape: Solid, camera: np.ndarray, size: int, extent: float) -> tuple[np.ndarray, np.ndarray]:
    """(size, size, 3) colour times coverage, and (size, size) coverage, from 3 × 3 rays a pixel."""
    seen, triangle, weights = rasterise((shape.vertices @ camera.T) / extent, shape.faces, 3 * size)
    colours = _shaded(shape, camera)
    corners = shape.faces[triangle]
    shaded = sum(weights[:, [i]] * colours[corners[:, i]] for i in range(3))
    fine = np.flatnonzero(seen)
    coarse = fine // (3 * size) // 3 * size + fine % (3 * size) // 3
    summed = [np.bincount(coarse, w, size * size) for w in (*np.asarray(shaded).T, np.ones(len(fine)))]
    *colour, coverage = (channel.reshape(size, size) / 9 for channel in summed)
    return np.stack(colour, axis=-1), coverage


def _over(background: np.ndarray, colour: np.ndarray, coverage: np.ndarray) -> np.ndarray:
    return background * (1 - coverage)[..., None] + colour


def _cross(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    return u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]


def _edge(o: np.ndarray, q: np.ndarray, area: np.ndarray) -> np.ndarray:
    """(T, 3) coefficients of column, row and 1 of a barycentric weight: it is zero on the edge from o to q."""
    u = q - o
    return (
        np.stack([-u[:, 1], u[:, 0], o[:, 0] * u[:, 1] - o[:, 1] * u[:, 0]], axis=1) / np.where(area, area, 1)[:, None]
    )


def _candidates(corners: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(triangle, column, row) of every pixel centre inside the bounding box of every (T, 3, 2) triangle."""
    low = np.clip(np.ceil(corners.min(1)), 0, size).astype(int)
    high = np.clip(np.floor(corners.max(1)) + 1, low, size).astype(int)
    width, height = (high - low).T
    count = width * height
    triangle = np.repeat(np.arange(len(corners)), count)
    local = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    row, column = np.divmod(local, np.maximum(width, 1)[triangle])
    return triangle, column + low[triangle, 0], row + low[triangle, 1]


def _sampled(field: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Trilinear values of a field on the volume's grid at points of the volume's frame; zero outside."""
    indices = (points + 1) / 2 * np.array(field.shape) - 0.5
    return ndimage.map_coordinates(field, indices.T, order=1, mode="constant")


def openness(occupied: np.ndarray, vertices: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Ambient occlusion, 0 dark to 1 open: how much of the shape lies above the tangent plane, at three scales."""
    occlusion = np.zeros(len(vertices))
    for sigma in (0.06, 0.14, 0.3):
        density = ndimage.gaussian_filter(occupied, sigma * max(occupied.shape) / 2, mode="constant")
        # On a flat wall one σ in front of it the blurred density is Φ(-1) = 0.16: that is not an occlusion.
        occlusion += np.clip(_sampled(density, vertices + sigma * normals) - 0.16, 0, 1)
    return np.exp(-1.6 * occlusion)


def _shaded(shape: Solid, camera: np.ndarray) -> np.ndarray:
    """Linear colour (V, 3) of each vertex: sky light by openness, and a key light that wraps and is shadowed."""
    normals = shape.normals @ camera.T
    sky = 0.34 * (0.62 + 0.38 * shape.normals[:, 1]) + 0.10 * np.clip(normals[:, 2], 0, 1)
    facing = np.clip((normals @ _KEY_LIGHT + 0.15) / 1.15, 0, 1)
    lit = facing * _sunlight(shape, _KEY_LIGHT @ camera)
    return _CLAY * (shape.openness * sky + 0.95 * lit * (0.5 + 0.5 * shape.openness))[:, None]


def _sunlight(shape: Solid, direction: np.ndarray, steps: int = 24, reach: float = 1.6) -> np.ndarray:
    """exp(-∫ density) towards the light through the blurred shape: a soft shadow."""
    start = shape.vertices + 0.1 * shape.normals
    distances = (np.arange(steps) + 0.5) / steps * reach
    path = (start[:, None] + distances[:, None] * direction).reshape(-1, 3)
    thickness = _sampled(shape.blurred, path).reshape(-1, steps).sum(1) * reach / steps
    return np.exp(-7 * thickness)


def _floor(shape: Solid, camera: np.ndarray, size: int, extent: float) -> np.ndarray:
    """White, and a soft shadow where the shape stands on the floor (not seen from below or straight ahead)."""
    picture = np.ones((size, size, 3))
    if camera[2, 1] < 0.02 or not len(shape.vertices):
        return picture
    lowest = shape.vertices[:, 1].min()
    centres = ((np.arange(size) + 0.5) / size * 2 - 1) * extent
    right, up = np.meshgrid(centres, -centres)
    points = right[..., None] * camera[0] + up[..., None] * camera[1]
    points = points + ((lowest - points[..., 1]) / camera[2, 1])[..., None] * camera[2]
    return picture * (1 - 0.5 * _contact_shadow(shape, lowest, points[..., 0], points[..., 2]))[..., None]


def _contact_shadow(shape: Solid, lowest: float, x: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Darkness in [0, 1] of the floor at (x, z): what stands above, the nearer the darker."""
    n = np.array(shape.blurred.shape)
    height = (np.arange(n[1]) + 0.5) / n[1] * 2 - 1 - lowest
    above = 1 - np.exp(-(shape.blurred * np.exp(-height.clip(0) / 0.5)[None, :, None]).sum(1) * 8 / n[1])
    margin = int(n[0] // 2)
    soft = ndimage.gaussian_filter(np.pad(above, margin), n[0] / 24)
    indices = [(x + 1) / 2 * n[0] - 0.5 + margin, (z + 1) / 2 * n[2] - 0.5 + margin]
    return ndimage.map_coordinates(soft, indices, order=1, mode="constant")
