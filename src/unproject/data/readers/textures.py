"""Materials from folders of texture maps, named as ambientCG, Poly Haven and most others name them.

A texture set in the metallic-roughness convention (base colour b, metallic w, roughness r) becomes maps for
`fresnel="albedo"`, where the specular albedo is the reflectance at normal incidence itself:

    F0 = (1 - w) 0.04 + w b       0.08 s in place of 0.04 where there is a specular map s
    k_d = (1 - w) b,   k_s = 0.2126 F0_r + 0.7152 F0_g + 0.0722 F0_b,   or F0 itself with specular="colour"
    m = r², at least 0.001        m = r with roughness="alpha"; r = 1 - g where there is glossiness g alone
    n = 2 v - 1, renormalised     y turned over if the map has it pointing down ("DX"); w is 0 without a map

A specular map that is coloured is itself in the place of 0.04. In the specular-glossiness convention (glossiness,
neither roughness nor metallic) a grey one is, too. Glossiness may be the alpha of a metallic or specular map. Without a
normal map, n comes from the height map if there is one, else the surface is flat. Maps of several sizes are
brought to the largest.

`texture_names.py` says which file is which map.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Literal, TypeAlias

import numpy as np
import torch
from torch import Tensor

from ..._files import paths_below
from ..._types import UserError
from ...ops.lengths import unit
from ...ops.maps import MAPS, check_maps, pack_maps, places
from .arrays import load_arrays
from .exported import exported_maps, exported_note
from .found import Found, check_size
from .framing import centred_square
from .texture_maps import DIELECTRIC, Convention, common_size, maps_of, pictures_of
from .texture_names import candidates, find_textures, holds_material, picture_names, sets_in

LARGEST = {
    "diffuse": (2.0, "an albedo to 1"),
    "specular": (100.0, "a reflectance to 1, or some times the 0.04 of glass"),
    "roughness": (10.0, "a slope to about 1"),
}
"""What a map in an .npz may run to, beyond which it surely is in another unit, as pictures of 0 to 255 are; and why."""


def read_material(
    folder: str | PathLike[str],
    size: int | None = None,
    *,
    roughness: Literal["perceptual", "alpha"] = "perceptual",
    normal: Literal["auto", "gl", "dx"] = "auto",
    colour: Literal["srgb", "linear"] = "srgb",
    specular: Literal["luminance", "colour"] = "luminance",
) -> Tensor:
    """Read the maps (8 or 10, H, W) of a folder of textures, packed as `ops.maps` says, meant for `fresnel="albedo"`.

    A folder that `unproject export` wrote says in its material.json what its pictures mean, and is read by that.

    Args:
        folder: holds a colour map and a roughness, a glossiness or a packed one (red occlusion, green roughness, blue
            metallic).
        size: side of the result, area averages of the largest centred square; default: as stored.
        roughness: what the map holds, or 1 - glossiness: "perceptual" r with m = r² (glTF, ambientCG, Poly Haven) or
            "alpha" m itself.
        normal: "gl" has green up and "dx" down; "auto" goes by the name, OpenGL where it says nothing.
        colour: how integer pixels of the colour map are encoded; floats are linear always.
        specular: "colour" keeps the colour of metals, in three channels of the specular albedo; "luminance" has one.

    Raises:
        UserError: for a map that is missing, double, damaged or of another shape, or values that cannot be that map's.
    """
    folder = Path(folder)
    if size is not None:
        check_size(folder, size)
    return _material(folder, size, Convention(roughness, normal, colour, specular))


def _material(folder: Path, size: int | None, convention: Convention, files: Sequence[Path] | None = None) -> Tensor:
    note = exported_note(folder)
    if note is not None:
        maps = exported_maps(folder, note, convention.specular == "colour")
    else:
        textures = find_textures(folder, convention.normal, files)
        pictures = pictures_of(textures)
        maps = maps_of(textures, pictures, convention, common_size(folder, pictures))
    return check_maps(_resized(pack_maps(maps), size), str(folder))[0]


def find_materials(
    path: Path,
    size: int | None = None,
    convention: Convention | None = None,
    strict: bool = False,
) -> Found:
    """Read materials (N, 8 or 10, size, size), or as stored, with their names, and which were skipped and why.

    A folder is a material, holds several side by side (`sets_in`), or folders of materials at any depth. An .npz
    holds `diffuse`, `specular`, `roughness` and `normal`, (N, C, H, W) or (C, H, W), floats as `unproject sample`
    writes them: taken as they are, with one or three specular channels.

    Raises:
        UserError: if there is no material, none that can be used, or with `strict` one that cannot.
    """
    meant = convention or Convention()
    check_size(path, size)
    if path.suffix.lower() == ".npz":
        return _from_arrays(path, size, meant.fresnel)
    folders = material_folders(path)
    found: dict[str, Tensor] = {}
    skipped: dict[str, str] = {}
    for name, (folder, files) in folders.items():
        try:
            found[name] = _material(folder, size, meant, files)
        except UserError as error:
            if strict or len(folders) == 1:
                raise
            skipped[name] = str(error)
    if not found:
        raise UserError(f"{path}: none of the {len(skipped)} materials can be used ({next(iter(skipped.values()))})")
    return Found(_stacked(path, found), tuple(found), None, tuple(skipped.items()), str(path))


def _stacked(path: Path, materials: Mapping[str, Tensor]) -> Tensor:
    sizes = {x.shape[-2:]: name for name, x in materials.items()}
    if len(sizes) > 1:
        (first, one), (second, two) = [*sizes.items()][:2]
        raise UserError(
            f"{path}: {one} is {first[1]} × {first[0]} pixels and {two} {second[1]} × {second[0]}; give a size for all"
        )
    return torch.stack([*materials.values()])


Place: TypeAlias = tuple[Path, "list[Path] | None"]
"""Where a material lies: a folder, and which of its files are its own, None for all."""


def material_folders(path: Path) -> dict[str, Place]:
    """Name → place: the folder itself if it is a material, else each below it that is or is meant to be one."""
    if not path.is_dir():
        found = "is a file" if path.exists() else "there is no such folder"
        raise UserError(f"{path}: {found}; name a folder of texture maps, or an .npz of maps")
    if side_by_side := sets_in(path):
        return {name: (path, files) for name, files in side_by_side.items()}
    if holds_material(path):
        return {path.name: (path, None)}
    below = [folder for folder in paths_below(path) if folder.is_dir() and _is_material(folder)]
    named: dict[str, Place] = {}
    for folder in below:
        name = folder.relative_to(path).as_posix()
        if any(part.startswith((".", "__")) for part in Path(name).parts):
            continue
        several = sets_in(folder)
        named |= {f"{name}/{one}": (folder, files) for one, files in several.items()} or {name: (folder, None)}
    return named or {path.name: (path, None)}


def pictures_of_no_map(path: Path, places: Mapping[str, Place]) -> list[Path]:
    """Return the pictures in and below a folder that lie in none of these places, or whose names are no maps'."""
    named: set[Path] = set()
    for folder, files in places.values():
        if exported_note(folder) is not None or not holds_material(folder):  # its note, or why it is skipped, says all
            named |= {*picture_names(folder)}
        else:
            named |= {file for role in candidates(folder, files).values() for file in role}
    folders = {path, *(folder for folder in paths_below(path) if folder.is_dir())}
    return sorted({file for folder in folders for file in picture_names(folder)} - named)


def _is_material(folder: Path) -> bool:
    """One with maps; or one with pictures and nothing below, whose names are wrong."""
    return holds_material(folder) or (bool(picture_names(folder)) and not any(p.is_dir() for p in folder.iterdir()))


def _from_arrays(path: Path, size: int | None, fresnel: str) -> Found:
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
        most, meant = LARGEST.get(name, (math.inf, ""))
        if values.max() > most:
            raise UserError(f"{path}: {name} runs to {values.max():.3g}, and {meant}; scale it, or decode it from sRGB")
        with np.errstate(over="ignore"):
            maps[name] = torch.from_numpy(values.astype(np.float32).reshape(-1, *values.shape[-3:]))
    try:
        packed = pack_maps(maps)
    except UserError as error:
        raise UserError(f"{path}: {error}") from None
    if fresnel == "albedo" and fresnel_of(path, arrays) == "eta":
        packed[:, places(packed.shape[1])["specular"]] *= DIELECTRIC
    names = arrays.get("names")
    if names is not None and names.shape != (len(packed),):
        raise UserError(f"{path}: names {names.shape} for {len(packed)} materials; give each one, or none")
    items = _resized(check_maps(packed, str(path)), size)
    return Found(items, None if names is None else [*map(str, names)], source=str(path))


def fresnel_of(path: Path, arrays: Mapping[str, np.ndarray]) -> Literal["eta", "albedo"]:
    """Return how the specular albedo of an .npz is meant: what it says, or `eta`.

    Raises:
        UserError: if it says something else.
    """
    meant = str(arrays.get("fresnel", "eta"))
    if meant not in ("eta", "albedo"):
        raise UserError(f"{path}: fresnel is {meant!r}; store 'eta' or 'albedo', or leave it out")
    return meant


def _resized(maps: Tensor, size: int | None) -> Tensor:
    """(B, C, size, size) of the largest centred square: area averages, bilinear where it grows; normals stay unit."""
    if size is None or maps.shape[-2:] == (size, size):
        return maps
    maps = centred_square(maps, size)
    place = places(maps.shape[1])["normal"]
    return torch.cat([maps[:, : place.start], unit(maps[:, place], 1)], 1)
