"""Materials from folders of texture maps, named as ambientCG, Poly Haven and most others name them.

A texture set in the metallic-roughness convention (base colour b, metallic w, roughness r) becomes maps for
`fresnel="albedo"`, where the specular albedo is the reflectance at normal incidence itself:

    F0 = (1 - w) 0.04 + w b       0.08 s in place of 0.04 where there is a specular map s
    k_d = (1 - w) b,   k_s = 0.2126 F0_r + 0.7152 F0_g + 0.0722 F0_b
    m = r², at least 0.001        m = r with roughness="alpha"
    n = 2 v - 1, renormalised     y turned over if the map has it pointing down ("DX"); w is 0 without a map

Without a normal map, n comes from the height map if there is one, else the surface is flat.

`texture_names.py` says which file is which map.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Literal

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from ..._openimage import Picture, read_picture
from ..._types import UserError
from ...ops.exposure import linear_from_srgb
from ...ops.maps import MAPS, check_maps, luminance, normals_of, pack_maps, slopes_of
from ..collection import check_size
from ..records import Records
from .arrays import load_arrays
from .framing import centred_square
from .texture_names import Textures, find_textures, holds_material, picture_names

DIELECTRIC, SPECULAR = 0.04, 0.08
SMOOTHEST = 1e-3
SLOPE = 0.25  # RMS slope given to a height map, whose unit no file says
OVERSHOOT = 0.02  # how far filters may take stored floats out of [0, 1]
COLOURED = 0.05  # mean difference of channels above which a picture is no grey map
INWARD, STEEPEST = 0.5, 0.02  # share of a normal map's texels that may point inward; the least z any gets
SHORTEST, LONGEST = 0.3, 1.5  # median length of its vectors: averaging rough surfaces shortens them


@dataclass(frozen=True)
class Convention:
    """How a texture set is meant: see `read_material`."""

    roughness: Literal["perceptual", "alpha"] = "perceptual"
    normal: Literal["auto", "gl", "dx"] = "auto"
    colour: Literal["srgb", "linear"] = "srgb"

    def __post_init__(self) -> None:
        allowed = {"roughness": ("perceptual", "alpha"), "normal": ("auto", "gl", "dx"), "colour": ("srgb", "linear")}
        for name, values in allowed.items():
            if getattr(self, name) not in values:
                raise UserError(f"material: {name} is one of {', '.join(values)}, not {getattr(self, name)!r}")


def read_material(
    folder: str | PathLike[str],
    size: int | None = None,
    *,
    roughness: Literal["perceptual", "alpha"] = "perceptual",
    normal: Literal["auto", "gl", "dx"] = "auto",
    colour: Literal["srgb", "linear"] = "srgb",
) -> Tensor:
    """The maps (8, H, W) of a folder of textures, as `ops.maps` packs them and `fresnel="albedo"` reads them.

    Args:
        folder: holds a colour map and a roughness or a packed one (red occlusion, green roughness, blue metallic).
        size: side of the result, area averages of the largest centred square; as stored unless given.
        roughness: what the map holds: "perceptual" r with m = r² (glTF, ambientCG, Poly Haven) or "alpha" m itself.
        normal: "gl" has green up and "dx" down; "auto" goes by the name, OpenGL where it says nothing.
        colour: how integer pixels of the colour map are encoded; floats are linear always.

    Raises:
        UserError: for a map that is missing, double, damaged or of another size, or values that cannot be that map's.
    """
    folder = Path(folder)
    if size is not None:
        check_size(folder, size)
    convention = Convention(roughness, normal, colour)
    textures = find_textures(folder, convention.normal)
    maps = _maps(textures, _same_size(folder, _pictures(textures)), convention)
    return check_maps(_resized(pack_maps(maps), size), str(folder))[0]


def read_materials(
    path: str | PathLike[str],
    size: int | None = None,
    *,
    strict: bool = False,
    roughness: Literal["perceptual", "alpha"] = "perceptual",
    normal: Literal["auto", "gl", "dx"] = "auto",
    colour: Literal["srgb", "linear"] = "srgb",
) -> tuple[Tensor, list[str]]:
    """Materials (N, 8, H, W) and their names, as `material_records` finds them.

    One that cannot be used is skipped with a warning that names it and says why.

    Raises:
        UserError: as `material_records`.
    """
    found = material_records(path, size, Convention(roughness, normal, colour), strict)
    if found.skipped:
        skipped, total = len(found.skipped), len(found.skipped) + len(found)
        warnings.warn(f"{skipped} of {total} materials skipped, the first: {found.skipped[0][1]}", stacklevel=2)
    return found.items, list(found.names)


def material_records(
    path: str | PathLike[str],
    size: int | None = None,
    convention: Convention | None = None,
    strict: bool = False,
) -> Records:
    """Materials (N, 8, size, size), or as stored, with their names, and which were skipped and why.

    A folder is a material, or holds folders of materials at any depth. An .npz holds `diffuse`, `specular`,
    `roughness` and `normal`, (N, C, H, W) or (C, H, W), floats as `unproject sample` writes them: taken as they are.

    Raises:
        UserError: if there is no material, none that can be used, or with `strict` one that cannot.
    """
    path, meant = Path(path), convention or Convention()
    check_size(path, size)
    if path.suffix.lower() == ".npz":
        return _from_arrays(path, size)
    folders = _material_folders(path)
    found: dict[str, Tensor] = {}
    skipped: dict[str, str] = {}
    for name, folder in folders.items():
        try:
            found[name] = read_material(folder, size, **vars(meant))
        except UserError as error:
            if strict or len(folders) == 1:
                raise
            skipped[name] = str(error)
    if not found:
        raise UserError(f"{path}: none of the {len(skipped)} materials can be used ({next(iter(skipped.values()))})")
    return Records.from_tensor(_stacked(path, found), None, tuple(found), tuple(skipped.items()), str(path))


def _stacked(path: Path, materials: Mapping[str, Tensor]) -> Tensor:
    sizes = {x.shape[-2:]: name for name, x in materials.items()}
    if len(sizes) > 1:
        (first, one), (second, two) = [*sizes.items()][:2]
        raise UserError(
            f"{path}: {one} is {first[1]} × {first[0]} pixels and {two} {second[1]} × {second[0]}; give a size for all"
        )
    return torch.stack([*materials.values()])


def _material_folders(path: Path) -> dict[str, Path]:
    """Name → folder: the folder itself if it is a material, else each below it that is or is meant to be one."""
    if not path.is_dir():
        raise UserError(f"{path}: there is no such folder; name a folder of texture maps, or an .npz of maps")
    if holds_material(path):
        return {path.name: path}
    below = sorted(folder for folder in path.rglob("*") if folder.is_dir())
    named = {folder.relative_to(path).as_posix(): folder for folder in below if _is_material(folder)}
    named = {name: f for name, f in named.items() if not any(p.startswith((".", "__")) for p in Path(name).parts)}
    return named or {path.name: path}


def _is_material(folder: Path) -> bool:
    """One with maps; or one with pictures and nothing below, whose names are wrong."""
    return holds_material(folder) or (bool(picture_names(folder)) and not any(p.is_dir() for p in folder.iterdir()))


def _from_arrays(path: Path, size: int | None) -> Records:
    arrays = load_arrays(path)
    maps = {}
    for name in (name for name in MAPS if name in arrays):
        values = arrays[name]
        if values.dtype.kind != "f":
            raise UserError(
                f"{path}: {name} holds {values.dtype} values, which would be read as linear; decode them and save "
                "linear float32"
            )
        if values.ndim not in (3, 4) or values.size == 0:
            raise UserError(
                f"{path}: {name} is of shape {values.shape}; give (N, C, H, W) or (C, H, W), none of them 0"
            )
        with np.errstate(over="ignore"):
            maps[name] = torch.from_numpy(values.astype(np.float32).reshape(-1, *values.shape[-3:]))
    try:
        packed = pack_maps(maps)
    except UserError as error:
        raise UserError(f"{path}: {error}") from None
    names = arrays.get("names")
    if names is not None and names.shape != (len(packed),):
        raise UserError(f"{path}: names {names.shape} for {len(packed)} materials; give each one, or none")
    items = _resized(check_maps(packed, str(path)), size)
    return Records.from_tensor(items, None, None if names is None else [*map(str, names)], source=str(path))


def _pictures(textures: Textures) -> dict[str, Picture]:
    """Role → picture, with 1 or 3 channels: alpha dropped."""
    pictures = {}
    for role, file in textures.files.items():
        pixels, stored = read_picture(file)
        if not np.isfinite(pixels).all():
            raise UserError(f"{file}: has values that are NaN or infinite; replace them")
        if pixels.shape[2] > 4:
            raise UserError(f"{file}: has {pixels.shape[2]} channels; save the {role} map alone, grey or RGB")
        pictures[role] = Picture(pixels[..., : 3 if pixels.shape[2] > 2 else 1], stored)
    return pictures


def _same_size(folder: Path, pictures: Mapping[str, Picture]) -> Mapping[str, Picture]:
    shapes = {role: picture.pixels.shape[1::-1] for role, picture in pictures.items()}
    for role, shape in shapes.items():
        if shape != shapes["colour"]:
            raise UserError(
                f"{folder}: {role} is {shape[0]} × {shape[1]} pixels but colour is {shapes['colour'][0]} × "
                f"{shapes['colour'][1]}; give all maps in one size"
            )
    return pictures


def _maps(textures: Textures, pictures: Mapping[str, Picture], convention: Convention) -> dict[str, Tensor]:
    """The four maps (1, C, H, W) by the formulas above."""
    colour = _colour(textures.files["colour"], pictures["colour"], convention.colour)
    flat = torch.zeros_like(colour[:1])
    grey = {role: _grey(textures.files[role], p) for role, p in pictures.items() if role in GREY}
    if "packed" in pictures:
        _, rough, metallic = _channels(textures.files["packed"], pictures["packed"])
        grey = {"roughness": rough[None], "metallic": metallic[None], **grey}
    metallic = grey.get("metallic", flat)
    f0 = torch.lerp(SPECULAR * grey["specular"] if "specular" in grey else flat + DIELECTRIC, colour, metallic)
    rough = grey["roughness"] ** 2 if convention.roughness == "perceptual" else grey["roughness"]
    maps = {
        "diffuse": colour * (1 - metallic),
        "specular": luminance(f0),
        "roughness": rough.clamp(min=SMOOTHEST),
        "normal": _normal(textures, pictures, flat),
    }
    return {name: value[None] for name, value in maps.items()}


GREY = ("roughness", "metallic", "specular")


def _unit(file: Path, picture: Picture) -> Tensor:
    """(C, H, W) in [0, 1]."""
    low, high = float(picture.pixels.min()), float(picture.pixels.max())
    if low < -OVERSHOOT or high > 1 + OVERSHOOT:
        raise UserError(f"{file}: values run from {low:.3g} to {high:.3g}; scale them to [0, 1] (normals as ½ + ½ n)")
    return torch.from_numpy(np.moveaxis(picture.pixels, 2, 0).copy()).clamp(0, 1)


def _channels(file: Path, picture: Picture) -> Tensor:
    if picture.pixels.shape[2] != 3:
        raise UserError(f"{file}: is a grey picture; a map of this name has three channels: mend the file or its name")
    return _unit(file, picture)


def _grey(file: Path, picture: Picture) -> Tensor:
    values = _unit(file, picture)
    if (values - values.mean(0)).abs().mean() > COLOURED:
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
    inward, length = (z <= 0).float().mean(), torch.stack([x, y, z]).norm(dim=0).median()
    if inward > INWARD or not SHORTEST < length < LONGEST:
        raise UserError(
            f"{file}: is no normal map ({100 * inward:.0f} % of its normals point inward, their median length is "
            f"{length:.2f}); give ½ + ½ n with z in blue, flat being (½, ½, 1)"
        )
    outward = torch.where(z > 0, z, (1 - x**2 - y**2).clamp(min=0).sqrt())
    return F.normalize(torch.stack([x, -y if down else y, outward.clamp(min=STEEPEST)]), dim=0)


def normals_from_height(h: Tensor) -> Tensor:
    """(3, H, W) `normals_of` s h, of a height map h (H, W) that repeats itself.

    s makes the RMS of the slope s |∇h| over the map as it is stored 0.25. A constant map is flat.
    """
    h = h.double()
    h_x, h_y = slopes_of(h)
    slope = (h_x**2 + h_y**2).mean().sqrt()
    gain = SLOPE / slope if slope > 0 else 0.0
    return normals_of(gain * h[None])[0].float()


def _resized(maps: Tensor, size: int | None) -> Tensor:
    """(B, 8, size, size) of the largest centred square: area averages, bilinear where it grows; normals stay unit."""
    if size is None or maps.shape[-2:] == (size, size):
        return maps
    maps = centred_square(maps, size)
    place = MAPS["normal"]
    return torch.cat([maps[:, : place.start], F.normalize(maps[:, place], dim=1)], 1)
