"""Pictures of what a projection makes, as a person would look at them."""

from __future__ import annotations

from PIL import Image
from torch import Tensor

from .. import export
from ..ops.maps import are_maps, unpack_maps
from ..projections import Selection, Standardised
from ..projections.base import Projection


def as_seen(projection: Projection, y: Tensor) -> Tensor:
    """Return pictures (M, 1 or 3, H, W) in [0, 1] of what a projection makes.

    Standardised images (M, C, H, W) are brought back first, the albedo and normals of materials shown as
    `export.map_picture` shows them, and lines (M, 1, D) by their graphs.
    """
    if isinstance(projection, Standardised):
        projection, y = projection.projection, projection.restore(y)
    if y.dim() == 3:
        return export.graphs(y)
    if isinstance(projection, Selection):
        y = export.map_picture(projection.map, y)
    elif are_maps(y):
        y = export.map_picture("diffuse", unpack_maps(y)["diffuse"])
    return y.clamp(0, 1)


def sheet_as_seen(projection: Projection, y: Tensor, columns: int, cell: int) -> Image.Image:
    """Return a sheet of pictures, as `as_seen`, or of shaded volumes (M, X, Y, Z), in cells of `cell` pixels."""
    if y.dim() == 4 and y.shape[1] not in (1, 3) and not are_maps(y):
        return export.gallery(y, size=cell, columns=columns)
    return export.picture_sheet(as_seen(projection, y), columns=columns, cell=cell)
