"""What people take away: meshes, voxels, arrays, sheets of pictures and turntables.

`write(volumes, to="glb", path="meshes/")` writes any of `FORMATS`; each format also has its own function.
"""

from __future__ import annotations

from collections.abc import Callable
from os import PathLike
from typing import Any

from numpy.typing import ArrayLike

from unproject._types import UserError
from unproject.export._volumes import Written, names_of
from unproject.export.arrays import npz
from unproject.export.material_gltf import material_gltf
from unproject.export.material_x import material_x
from unproject.export.materials import material_maps
from unproject.export.meshes import glb, mesh, obj, ply
from unproject.export.pictures import (
    contact_sheet,
    gallery,
    graphs,
    grouped_sheet,
    map_picture,
    material_sheet,
    picture_sheet,
    save_image,
    sheet_file,
    silhouette_sheet,
    turntable,
    turntable_file,
)
from unproject.export.rendering import render_volume
from unproject.export.vox import vox

__all__ = [
    "FORMATS",
    "MATERIAL_FORMATS",
    "MESHES",
    "Written",
    "contact_sheet",
    "gallery",
    "glb",
    "graphs",
    "grouped_sheet",
    "map_picture",
    "material_gltf",
    "material_maps",
    "material_sheet",
    "material_x",
    "mesh",
    "names_of",
    "npz",
    "obj",
    "picture_sheet",
    "ply",
    "render_volume",
    "save_image",
    "silhouette_sheet",
    "turntable",
    "vox",
    "write",
]

FORMATS: dict[str, Callable[..., Written]] = {
    "glb": glb,
    "obj": obj,
    "ply": ply,
    "vox": vox,
    "npz": npz,
    "png": sheet_file,
    "gif": turntable_file,
}
"""Format → the function (volumes, path, **options) that writes it; png is the contact sheet, gif the turntable."""

MESHES = (glb, obj, ply)
"""Exporters that take `largest`, and `names` as `vox` does."""

MATERIAL_FORMATS: dict[str, Callable[..., Written]] = {
    "maps": material_maps,
    "mtlx": material_x,
    "gltf": material_gltf,
}
"""Format → the function (maps, path, **options) that writes it; options are names, depth, fresnel and eta."""


def write(volumes: ArrayLike, to: str, path: str | PathLike[str], **options: Any) -> Written:
    """Write the volumes in one of `FORMATS` to a file (its suffix is the format's) or into a folder.

    Raises:
        UserError: an unknown format, or nothing to write. OSError: the disk; no file is left half-written.
    """
    if to not in FORMATS:
        raise UserError(f"there is no format {to!r} to export to: use one of {', '.join(FORMATS)}")
    return FORMATS[to](volumes, path, **options)
