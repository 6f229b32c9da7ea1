"""Folders of pictures of materials, one sub-folder for each observation: `diffuse/`, `normal/`, `top/`, `grazing/`, …

What each holds need not belong together: no two pictures need show the same material. Maps are read as artists store
them (sRGB albedos, perceptual roughness r with m = r², normals as ½ + ½ n, y up), photographs as they are, but what is
stored as floats (.exr, .hdr) is linear: photographs of it are developed with gamma 2.2 and clamped at 1.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..._files import files_with
from ..._pictures import OVERSHOOT, read_stored
from ..._types import UserError
from ...ops.exposure import develop, linear_from_srgb
from ...ops.lengths import unit
from ...ops.maps import CHANNELS, COLOURED, MAPS, places
from .found import Found
from .framing import centred_square
from .lights import SAVE, SUFFIXES, UNREAD, sub_folder
from .texture_names import DOWN, packed_channels, role_of, says, words_of

SMOOTHEST = 1e-3
TRANSPARENT, CUT_OUT, CLIPPED, GREY = 0.5, 0.01, 0.25, 0.02
"""Alpha below which a pixel is cut out; shares of such pixels, and of values beyond white, that a photograph may have;
and how much channels of a normal map differ at least in the mean."""


def find_photographs(path: Path, name: str, size: int, strict: bool = False, coloured: bool = False) -> Found:
    """Read the pictures (N, C, size, size) of the sub-folder `name`: a map's channels, or a photograph's three.

    The largest centred square of each picture is taken and averaged down. Of specular maps the mean of the channels is
    read, or with `coloured` all three.

    Raises:
        UserError: if there is no such sub-folder, no picture in it, or none that can be used.
    """
    folder = sub_folder(path, name) or path / name
    files = files_with(folder, SUFFIXES)
    if not files and (unread := files_with(folder, UNREAD)):
        raise UserError(f"{folder}: holds no picture that can be read: {unread[0].suffix} is not, {SAVE}")
    if not files:
        raise UserError(f"{folder}: holds no picture; put some there, or leave {name} out of the observations")
    found: dict[str, Tensor] = {}
    skipped: dict[str, str] = {}
    for file in files:
        try:
            found[file.relative_to(path).as_posix()] = photograph(file, name, size, coloured)
        except UserError as reason:
            if strict:
                raise
            skipped[file.relative_to(path).as_posix()] = str(reason).removeprefix(f"{file}: ")
    if not found:
        first = ": ".join(next(iter(skipped.items())))
        raise UserError(f"{folder}: none of the {len(files)} pictures can be used ({first})")
    return Found(torch.stack([*found.values()]), tuple(found), None, tuple(skipped.items()), str(folder))


def photograph(file: Path, name: str, size: int, coloured: bool = False) -> Tensor:
    """(C, size, size) of the largest centred square: a map's values, or a photograph as it is."""
    place = places(COLOURED if coloured else CHANNELS).get(name, slice(0, 3))
    values = _square(file, name, size, place.stop - place.start)
    if name == "roughness":
        return ((1 - values if role_of(words_of(file.stem)) == "glossiness" else values) ** 2).clamp(min=SMOOTHEST)
    return _normals(file, values) if name == "normal" else values


def _square(file: Path, name: str, size: int, wanted: int) -> Tensor:
    """So many channels; colours linear."""
    pixels, stored = read_stored(file)
    if not np.isfinite(pixels).all():
        raise UserError(f"{file}: has values that are NaN or infinite; fix or remove it")
    _check_opaque(file, name, pixels)
    pixels = pixels[..., : 3 if pixels.shape[2] >= 3 else 1]
    if name not in MAPS and (pixels.max() <= 0 or pixels.min() >= 1):
        raise UserError(f"{file}: is {'black' if pixels.max() <= 0 else 'white'} throughout; remove it")
    _check_exposure(file, name, pixels, stored)
    if name == "roughness" and role_of(words_of(file.stem)) == "packed":
        pixels = pixels[..., [packed_channels(file)[0]]] if pixels.shape[2] == 3 else pixels
    if name == "normal" and pixels.min() < -OVERSHOOT:
        raise UserError(f"{file}: values run from {pixels.min():.3g}; give normals as ½ + ½ n, flat being (½, ½, 1)")
    if name in MAPS and pixels.max() > 1 + OVERSHOOT:
        raise UserError(f"{file}: values run to {pixels.max():.3g}; scale maps to [0, 1]")
    values = torch.from_numpy(np.moveaxis(pixels, 2, 0).copy()).clamp(min=0)
    side = min(values.shape[1:])
    if side < size // 2:
        raise UserError(
            f"{file}: is {values.shape[2]} × {values.shape[1]} pixels, too few for {size}; give larger ones"
        )
    if name == "diffuse" and "int" in stored:
        values = linear_from_srgb(values)
    if name not in MAPS and "int" not in stored:
        values = develop(values)
    values = centred_square(values[None], size)[0].clamp(max=1)
    return (values.mean(0, keepdim=True) if wanted == 1 else values.expand(wanted, -1, -1)).float()


def _check_opaque(file: Path, name: str, pixels: np.ndarray) -> None:
    """Refuse pictures of nothing, and photographs of which a part is cut out: what lies under it is no surface."""
    if pixels.shape[2] not in (2, 4):
        return
    side, (height, width) = min(pixels.shape[:2]), pixels.shape[:2]
    top, left = (height - side) // 2, (width - side) // 2
    alpha = pixels[top : top + side, left : left + side, -1]
    if not pixels[..., -1].any():
        raise UserError(f"{file}: is transparent throughout; remove it")
    if name not in MAPS and (alpha < TRANSPARENT).mean() > CUT_OUT:
        share = f"{(alpha < TRANSPARENT).mean():.0%}"
        raise UserError(f"{file}: is transparent in {share} of its middle square; crop it to the material")


def _check_exposure(file: Path, name: str, pixels: np.ndarray, stored: str) -> None:
    """Refuse photographs of linear light most of whose colours would be white, or are below black."""
    if name in MAPS or "int" in stored:
        return
    clipped = float((pixels > 1).mean())
    if clipped > CLIPPED:
        white = np.quantile(pixels, 0.99)
        raise UserError(f"{file}: {clipped:.0%} of its values are above 1, which is white; divide them by {white:.3g}")
    below = float((pixels < 0).mean())
    if below > CLIPPED:
        raise UserError(f"{file}: {below:.0%} of its values are negative, as no light is; give linear radiance")


def _normals(file: Path, values: Tensor) -> Tensor:
    """n = 2 v - 1, renormalised; y is turned over if the name says that it points down."""
    normal = 2 * values - 1
    grey = bool((values.amax(0) - values.amin(0)).mean() < GREY)
    if grey or normal[2].mean() < 0.2:
        raise UserError(f"{file}: is no normal map; give ½ + ½ n with z in blue, flat being (½, ½, 1)")
    normal[2].clamp_(min=0.05)
    return unit(normal * normal.new_tensor([1, -1 if says(file, DOWN) else 1, 1])[:, None, None], 0)
