"""Folders of pictures of materials, one sub-folder a way of looking: `diffuse/`, `normal/`, `top/`, `grazing/`, …

What each holds need not belong together: no two pictures need show the same material. Maps are read as artists store
them (sRGB albedos, perceptual roughness r with m = r², normals as ½ + ½ n, y up), photographs as they are.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from .._openimage import read_picture
from .._types import UserError
from ..ops.maps import MAPS
from .folder import SUFFIXES
from .framing import centred_square
from .material_sets import linear_from_srgb
from .records import Records

FLOATING = (".exr", ".hdr")
SMOOTHEST = 1e-3


def read_sightings(path: Path, name: str, size: int, strict: bool = False) -> Records:
    """(N, C, size, size) of the sub-folder `name`: a map's channels, or a photograph's three.

    The largest centred square of each picture is taken and averaged down.

    Raises:
        UserError: if there is no such sub-folder, no picture in it, or none that can be used.
    """
    folder = path / name
    files = (
        sorted(f for f in folder.rglob("*") if f.suffix.lower() in (*SUFFIXES, *FLOATING)) if folder.is_dir() else []
    )
    if not files:
        raise UserError(f"{folder}: holds no picture; put some there, or leave {name} out of --observations")
    found: dict[str, Tensor] = {}
    skipped: dict[str, str] = {}
    for file in files:
        try:
            found[file.relative_to(path).as_posix()] = _sighting(file, name, size)
        except UserError as reason:
            if strict:
                raise
            skipped[file.relative_to(path).as_posix()] = str(reason)
    if not found:
        raise UserError(f"{folder}: none of the {len(files)} pictures can be used ({next(iter(skipped.values()))})")
    return Records.from_tensor(torch.stack([*found.values()]), None, tuple(found), tuple(skipped.items()), str(folder))


def holds_sightings(path: Path, names: tuple[str, ...]) -> bool:
    """Whether a folder has a sub-folder of one of these names."""
    return any((path / name).is_dir() for name in names)


def _sighting(file: Path, name: str, size: int) -> Tensor:
    pixels, stored = read_picture(file)
    if not np.isfinite(pixels).all():
        raise UserError(f"{file}: has values that are NaN or infinite; mend or remove it")
    values = torch.from_numpy(np.moveaxis(pixels[..., : 3 if pixels.shape[2] >= 3 else 1], 2, 0).copy()).clamp(min=0)
    side = min(values.shape[1:])
    if side < size // 2:
        raise UserError(
            f"{file}: is {values.shape[2]} × {values.shape[1]} pixels, too few for {size}; give larger ones"
        )
    if name == "diffuse" and "int" in stored:
        values = linear_from_srgb(values)
    wanted = MAPS[name].stop - MAPS[name].start if name in MAPS else 3
    values = centred_square(values[None], size)[0]
    values = values.mean(0, keepdim=True) if wanted == 1 else values.expand(wanted, -1, -1)
    if name == "roughness":
        values = (values**2).clamp(min=SMOOTHEST)
    if name == "normal":
        normal = 2 * values - 1
        if normal[2].mean() < 0.2:
            raise UserError(f"{file}: is no normal map; give ½ + ½ n with z in blue, flat being (½, ½, 1)")
        normal[2].clamp_(min=0.05)
        values = F.normalize(normal, dim=0)
    return values.float()
