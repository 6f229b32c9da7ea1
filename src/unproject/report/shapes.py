"""Shapes for the page's viewer: quantised meshes with baked-in ambient occlusion."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
import torch.nn.functional as F
from scipy import ndimage
from torch import Tensor

from .. import export
from .._types import UserError
from ..export.rendering import openness, vertex_normals
from .numbers import encoded

COUNT, FACES = 8, 16_000
"""Shapes to choose from, and triangles of each at most."""
FINEST = 64
"""Voxels a side that meshes are made of at most: finer ones would be decimated anyway."""


def shape_data(volumes: Tensor, count: int = COUNT, faces: int = FACES) -> dict[str, Any]:
    """Return what viewer.js draws: of each of the first volumes (N, X, Y, Z) the triangles, in base64.

    `points` int16 (V, 3) are coordinates times 32767, `normals` int8 (V, 3) times 127, `open` uint8 (V,) is how open
    the sky is at a vertex times 255, `faces` uint16 (F, 3), counter-clockwise from outside. Empty shapes are left out.
    """
    shapes = []
    for k, volume in enumerate(volumes[:count].float()):
        found = _mesh(_coarsened(volume).numpy(), faces)
        if found is not None:
            shapes.append({"name": f"sample {k}", **found})
    return {"kind": "shapes", "items": shapes}


def _coarsened(volume: Tensor) -> Tensor:
    times = -(-max(volume.shape) // FINEST)
    return F.avg_pool3d(volume[None, None], times, ceil_mode=True)[0, 0] if times > 1 else volume


def _mesh(volume: np.ndarray, faces: int) -> dict[str, Any] | None:
    try:
        surface = export.mesh(volume, faces=faces)
    except UserError:  # nothing above the level
        return None
    if len(surface.faces) > faces and min(volume.shape) >= 8:  # decimating would have opened it
        return _mesh(ndimage.zoom(volume, 0.75, order=1), faces)
    points, triangles = np.asarray(surface.vertices, np.float64), np.asarray(surface.faces)
    if len(triangles) > faces or len(points) > 65_535:
        return None
    normals = vertex_normals(points, triangles)
    sky = openness((np.clip(volume, 0, 1) > 0.5).astype(np.float32), points, normals)
    return {
        "points": encoded(points * 32_767, np.int16),
        "normals": encoded(normals * 127, np.int8),
        "open": encoded(sky * 255, np.uint8),
        "faces": encoded(triangles, np.uint16),
        "triangles": len(triangles),
    }


def is_drawable(x: Tensor) -> bool:
    """Whether these samples are volumes that meshes can be made of."""
    return x.dim() == 4 and min(x.shape[1:]) >= 4 and bool(torch.isfinite(x).all())
