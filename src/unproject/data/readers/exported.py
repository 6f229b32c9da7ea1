"""Materials as `unproject export` writes them: pictures, and material.json, which says what their numbers mean."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..._files import read_json, understood
from ..._pictures import read_stored
from ..._types import UserError
from ...ops.exposure import linear_from_srgb
from ...ops.lengths import unit
from ...ops.maps import luminance
from .texture_maps import COLOURED, SMOOTHEST

NOTE, FORMAT = "material.json", "unproject material"
FIX = f"export the material again, or remove {NOTE} to have its pictures read as any texture maps"
ROUNDING = 1e-3
CHANNELS = {"basecolor": (3,), "specular": (1, 3), "roughness": (1,), "normal": (3,)}


def exported_note(folder: Path) -> dict[str, Any] | None:
    """Return what material.json says of each picture, by name; None if there is none, or it is another program's.

    Raises:
        UserError: if it is damaged.
    """
    file = folder / NOTE
    if not file.is_file() or FORMAT not in file.read_text(encoding="utf-8", errors="replace"):
        return None
    content = read_json(file, FIX)
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        return None
    with understood(file, FIX):
        maps = {name: content["maps"][name] for name in CHANNELS}
        for about in maps.values():
            beside = about["file"] not in ("", "..") and Path(about["file"]).name == about["file"]
            if not beside or about["encoding"] not in ("sRGB", "linear"):
                raise ValueError(f"{about['file']!r} in {about['encoding']!r} is no picture beside it")
            if not 0 < float(about["scale"]) < math.inf:
                raise ValueError(f"the scale {about['scale']!r} is no positive number")
    return maps


def exported_maps(folder: Path, note: dict[str, Any], tinted: bool) -> dict[str, Tensor]:
    """Return the four maps (1, C, H, W): k_d, k_s = F0 (its luminance, or with `tinted` three channels), m = r², n."""
    found = {name: _decoded(folder / about["file"], about, CHANNELS[name]) for name, about in note.items()}
    sizes = {name: values.shape[1:] for name, values in found.items()}
    if len({*sizes.values()}) > 1:
        said = ", ".join(f"{name} {width} × {height}" for name, (height, width) in sizes.items())
        raise UserError(f"{folder}: pictures differ in size ({said}); {FIX}")
    f0 = found["specular"]
    maps = {
        "diffuse": found["basecolor"],
        "specular": f0.expand(3, -1, -1) if tinted else luminance(f0) if len(f0) == 3 else f0,
        "roughness": (found["roughness"] ** 2).clamp(min=SMOOTHEST),
        "normal": _outward(2 * found["normal"] - 1),
    }
    return {name: values[None] for name, values in maps.items()}


def _outward(normal: Tensor) -> Tensor:
    """Unit normals: half floats round a least z to 0."""
    x, y, z = normal
    return unit(torch.stack([x, y, torch.where(z > -ROUNDING, z.clamp(min=ROUNDING), z)]), 0)


def _decoded(file: Path, about: dict[str, Any], channels: tuple[int, ...]) -> Tensor:
    """The quantity (C, H, W), linear: the picture without its encoding, times its scale."""
    pixels = read_stored(file).pixels
    pixels = pixels[..., : 3 if pixels.shape[2] > 2 else 1]  # without alpha, which other programs add
    if not np.isfinite(pixels).all():
        raise UserError(f"{file}: has values that are no numbers; {FIX}")
    values = torch.from_numpy(np.moveaxis(pixels, 2, 0).copy())
    if channels == (1,):
        grey = values.mean(0, keepdim=True)
        if (values - grey).abs().mean() > COLOURED:
            raise UserError(f"{file}: is coloured where a grey picture is meant; {FIX}")
        values = grey
    elif len(values) not in channels:
        values = values.expand(3, -1, -1)
    return (linear_from_srgb(values) if about["encoding"] == "sRGB" else values) * float(about["scale"])
