"""From the pictures of a texture set to the maps of a material: the formulas of `textures.py`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..._pictures import OVERSHOOT, Picture, read_stored
from ..._types import UserError
from ...ops.exposure import linear_from_srgb
from ...ops.lengths import length, unit
from ...ops.maps import luminance, normals_of, slopes_of
from .texture_names import Textures, packed_channels

DIELECTRIC, SPECULAR = 0.04, 0.08
SMOOTHEST = 1e-3
SLOPE, MEASURED = 0.25, 512  # RMS slope given to a height map, whose unit no file says; pixels a side it is taken at
COLOURED = 0.05  # mean difference of channels above which a picture is no grey map
INWARD, STEEPEST = 0.5, 0.02  # share of a normal map's texels that may point inward; the least z any gets
SHORTEST, LONGEST = 0.3, 1.5  # median length of its vectors: averaging rough surfaces shortens them


@dataclass(frozen=True)
class Convention:
    """How a texture set is meant: see `read_material`."""

    roughness: Literal["perceptual", "alpha"] = "perceptual"
    normal: Literal["auto", "gl", "dx"] = "auto"
    colour: Literal["srgb", "linear"] = "srgb"
    specular: Literal["luminance", "colour"] = "luminance"
    fresnel: Literal["stored", "albedo"] = "stored"
    """Of an .npz whose `fresnel` is "eta", or that says nothing: its specular map as stored, or the reflectance
    0.04 k_s that it means."""

    def __post_init__(self) -> None:
        allowed = {"roughness": ("perceptual", "alpha"), "normal": ("auto", "gl", "dx"), "colour": ("srgb", "linear")}
        allowed |= {"specular": ("luminance", "colour"), "fresnel": ("stored", "albedo")}
        for name, values in allowed.items():
            if getattr(self, name) not in values:
                raise UserError(f"material: {name} is one of {', '.join(values)}, not {getattr(self, name)!r}")


def pictures_of(textures: Textures) -> dict[str, Picture]:
    """Role → picture, with 1 or 3 channels: alpha dropped, but where it is the glossiness."""
    pictures = {}
    for role, file in textures.files.items():
        pixels, stored = read_stored(file)
        if not np.isfinite(pixels).all():
            raise UserError(f"{file}: has values that are NaN or infinite; replace them")
        if pixels.shape[2] > 4:
            raise UserError(f"{file}: has {pixels.shape[2]} channels; save the {role} map alone, grey or RGB")
        if role.endswith("_glossiness"):
            if pixels.shape[2] not in (2, 4):
                raise UserError(f"{file}: has no alpha, which holds the glossiness by its name; save it with alpha")
            pictures.setdefault("glossiness", Picture(pixels[..., -1:], stored))
            role = role.removesuffix("_glossiness")
        pictures.setdefault(role, Picture(pixels[..., : 3 if pixels.shape[2] > 2 else 1], stored))
    return pictures


def common_size(folder: Path, pictures: Mapping[str, Picture]) -> tuple[int, int]:
    """Return height and width of the largest map.

    Raises:
        UserError: if one is of another shape, by more than the rounding of a side.
    """
    shapes = {role: picture.pixels.shape[:2] for role, picture in pictures.items()}
    largest = max(shapes, key=lambda role: shapes[role])
    height, width = shapes[largest]
    for role, (h, w) in shapes.items():
        if min(abs(w - width * h / height), abs(h - height * w / width)) > 1:
            raise UserError(
                f"{folder}: {role} is {w} × {h} pixels but {largest} is {width} × {height}; give all maps in one shape"
            )
    return height, width


def _at(size: tuple[int, int], x: Tensor) -> Tensor:
    """Return a decoded map (C, h, w) at the size of the largest, bilinear."""
    return x if x.shape[1:] == size else F.interpolate(x[None], size, mode="bilinear", align_corners=False)[0]


def maps_of(
    textures: Textures, pictures: Mapping[str, Picture], convention: Convention, size: tuple[int, int]
) -> dict[str, Tensor]:
    """The four maps (1, C, H, W) by the formulas above, all of one size."""
    colour = _at(size, _colour(textures.files["colour"], pictures["colour"], convention.colour))
    flat = torch.zeros_like(colour[:1])
    reflected, tinted = flat + DIELECTRIC, convention.specular == "colour"
    if "specular" in pictures:
        itself = {"roughness", "packed", "metallic"}.isdisjoint(pictures)
        reflected = _at(size, _reflectance(textures.file_of("specular"), pictures["specular"], itself))
    grey = {role: _at(size, _grey(textures.file_of(role), p)) for role, p in pictures.items() if role in GREY}
    if "packed" in pictures:
        packed = _at(size, _channels(textures.files["packed"], pictures["packed"]))
        rough, metallic = packed_channels(textures.files["packed"])
        grey = {"roughness": packed[rough][None], "metallic": packed[metallic][None], **grey}
    metallic = grey.get("metallic", flat)
    f0 = torch.lerp(reflected, colour, metallic)
    rough = grey["roughness"] if "roughness" in grey else 1 - grey["glossiness"]
    rough = rough**2 if convention.roughness == "perceptual" else rough
    maps = {
        "diffuse": colour * (1 - metallic),
        "specular": f0 if tinted else luminance(f0),
        "roughness": rough.clamp(min=SMOOTHEST),
        "normal": unit(_at(size, _normal(textures, pictures, flat)), 0),
    }
    return {name: value[None] for name, value in maps.items()}


GREY = ("roughness", "glossiness", "metallic")


def _unit(file: Path, picture: Picture) -> Tensor:
    """(C, H, W) in [0, 1]."""
    low, high = float(picture.pixels.min()), float(picture.pixels.max())
    if low < -OVERSHOOT or high > 1 + OVERSHOOT:
        raise UserError(f"{file}: values run from {low:.3g} to {high:.3g}; scale them to [0, 1] (normals as ½ + ½ n)")
    return torch.from_numpy(np.moveaxis(picture.pixels, 2, 0).copy()).clamp(0, 1)


def _channels(file: Path, picture: Picture) -> Tensor:
    if picture.pixels.shape[2] != 3:
        raise UserError(f"{file}: is a grey picture; a map of this name has three channels: fix the file or its name")
    return _unit(file, picture)


def _reflectance(file: Path, picture: Picture, itself: bool) -> Tensor:
    """F0 of a specular map: 0.08 s of a grey one s; a coloured one, or any if `itself`, as it is.

    That is in sRGB if stored as integers.
    """
    as_it_is = itself or _is_coloured(picture)
    return _colour(file, picture, "srgb") if as_it_is else SPECULAR * _grey(file, picture)


def _is_coloured(picture: Picture) -> bool:
    pixels = picture.pixels
    return bool(np.abs(pixels - pixels.mean(2, keepdims=True)).mean() > COLOURED)


def _grey(file: Path, picture: Picture) -> Tensor:
    values = _unit(file, picture)
    if _is_coloured(picture):
        raise UserError(
            f"{file}: is coloured where a grey map is meant; save it grey, or name it `arm` if red, green and blue are "
            "occlusion, roughness and metallic"
        )
    return values.mean(0, keepdim=True)


def _colour(file: Path, picture: Picture, encoding: str) -> Tensor:
    """The colour map (3, H, W), linear."""
    if encoding == "linear" and picture.stored in ("uint8", "int8"):
        raise UserError(f'{file}: 8 bits hold sRGB values, too few for linear ones; read it with colour="srgb"')
    values = _unit(file, picture).expand(3, -1, -1)
    return linear_from_srgb(values) if encoding == "srgb" and "int" in picture.stored else values


def _normal(textures: Textures, pictures: Mapping[str, Picture], flat: Tensor) -> Tensor:
    """(3, H, W) unit normals."""
    if "normal" in pictures:
        return _decoded(textures.files["normal"], pictures["normal"], textures.down)
    if "height" in pictures:
        return normals_from_height(torch.from_numpy(pictures["height"].pixels.mean(-1)))
    return torch.cat([flat, flat, flat + 1])


def _decoded(file: Path, picture: Picture, down: bool) -> Tensor:
    """n = 2 v - 1 of a normal map, renormalised; y is turned over if it points down.

    Texels that point inward, as bakes of undercut shapes leave them, get z = √(1 - x² - y²), as engines that store x
    and y alone show them.
    """
    x, y, z = 2 * _channels(file, picture) - 1
    inward, typical = (z <= 0).float().mean(), length(torch.stack([x, y, z]), 0).median()
    if inward > INWARD or not SHORTEST < typical < LONGEST:
        raise UserError(
            f"{file}: is no normal map ({100 * inward:.0f} % of its normals point inward, their median length is "
            f"{typical:.2f}); give ½ + ½ n with z in blue, flat being (½, ½, 1)"
        )
    if not _is_coloured(picture):
        raise UserError(f"{file}: is no normal map but grey, as a height map is; give ½ + ½ n with z in blue")
    outward = torch.where(z > 0, z, (1 - x**2 - y**2).clamp(min=0).sqrt())
    return unit(torch.stack([x, -y if down else y, outward.clamp(min=STEEPEST)]), 0)


def normals_from_height(h: Tensor) -> Tensor:
    """(3, H, W) `normals_of` s h, of a height map h (H, W) that repeats itself.

    s makes the RMS of the slope s |∇h| 0.25, over the map averaged to at most 512 pixels a side: of larger ones of 8
    bits slopes between pixels are mostly the steps of the grey levels. A constant map is flat.
    """
    h = h.double()
    times = -(-max(h.shape) // MEASURED)
    h_x, h_y = (slope / times for slope in slopes_of(F.avg_pool2d(h[None], min(times, *h.shape))[0]))
    slope = (h_x**2 + h_y**2).mean().sqrt()
    gain = SLOPE / slope if slope > 0 else 0.0
    return normals_of(gain * h[None])[0].float()
