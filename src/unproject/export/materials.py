"""Material maps as an artist's tools expect them: a folder of pictures, and a note that says what their numbers mean.

From the maps of `ops.maps` (linear; roughness m is the RMS slope, Beckmann's alpha) each exporter takes

    base colour   k_d                                     of the diffuse lobe
    specular      F0 = k_s · ((eta - 1) / (eta + 1))²     reflectance at normal incidence, if fresnel is "eta"
                  F0 = k_s                                if it is "albedo"
    roughness     r = √m                                  perceptual: tools square it to get alpha
    normal        v = (n + 1) / 2                         OpenGL's convention: x right, y up in the picture

Specular is a picture of one channel, or of three if k_s is coloured.
Base colour is sRGB encoded in PNG and linear in EXR; all else is linear. A picture that cannot hold values above 1
holds them divided by a scale, and the note says so.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
import torch
from numpy.typing import ArrayLike

from unproject._files import files_below, filled_folder
from unproject._pictures import Depth, write_picture
from unproject._types import UserError
from unproject.export._volumes import Written, names_for, names_of, save, warn_left
from unproject.ops.maps import check_maps, unpack_maps

Fresnel = Literal["eta", "albedo"]
MapDepth = Literal["8", "16", "half", "float"]


class Storage(NamedTuple):
    """A way of storing pictures and the largest number it holds."""

    suffix: str
    stored: Depth
    largest: float


_STORAGE: dict[str, Storage] = {
    "8": Storage("png", "uint8", 1),
    "16": Storage("png", "uint16", 1),
    "half": Storage("exr", "half", 65504),
    "float": Storage("exr", "float", math.inf),
}
_MEANING = {
    "basecolor": "diffuse albedo k_d",
    "specular": "F0, the reflectance at normal incidence",
    "roughness": "perceptual roughness r = sqrt(m); m = r² is the RMS slope, alpha of a Beckmann distribution",
    "normal": "v = (n + 1) / 2 of the unit normal n; x right, y up in the picture (OpenGL), z out of the surface",
}
_FORMAT = "unproject material"
_OWN = ("material.mtlx", *(f"{name}.{suffix}" for name in _MEANING for suffix in ("png", "exr")))
_MODEL = (
    "k_d / pi + D G F / (4 cos_i cos_o): Beckmann's D with alpha = m, separable Smith G, Schlick's F rising from F0; "
    "a tool with another D takes the same alpha for a lobe much like it"
)


class Material(NamedTuple):
    """What the artist's maps hold, (H, W, C) float32: linear k_d, F0 (of 1 or 3 channels) and r, and unit normals."""

    basecolor: np.ndarray
    specular: np.ndarray
    roughness: np.ndarray
    normal: np.ndarray


class Sheet(NamedTuple):
    """A picture of one map: its file, how it is stored and encoded; the map is scale · what is decoded."""

    file: str
    stored: Depth
    encoding: Literal["linear", "sRGB"]
    scale: float


def material_maps(
    maps: ArrayLike,
    path: str | PathLike[str],
    *,
    names: Sequence[str] | None = None,
    depth: MapDepth = "8",
    fresnel: Fresnel = "albedo",
    eta: float = 1.5,
) -> Written:
    """A folder of basecolor, specular, roughness and normal, with material.json; material-00/, ... of a batch.

    Args:
        maps: (8, H, W), or (N, 8, H, W) with a folder for each; 10 channels of coloured k_s; a tensor or an array.
        names: of the folders of a batch.
        depth: "8" or "16" bits of PNG, "half" or "float" EXR. Eight bits tell F0 apart in steps of 0.004, of which a
            dielectric's 0.04 has ten: prefer another depth for those.
        fresnel, eta: what k_s means.

    Raises:
        UserError: maps that are no material, or a path that is no folder. OSError: the disk. A new folder appears
            whole or not at all; into one that exists whole files are moved once all are written, the note last.
    """
    materials, storage = as_materials(maps, fresnel, eta, names), storage_of(depth)
    return write_folders(materials, path, lambda folder, m: write_maps(folder, m, storage, fresnel, eta), names is None)


def storage_of(depth: MapDepth) -> Storage:
    """Return how pictures of this depth are stored."""
    if depth not in _STORAGE:
        raise UserError(f"depth: there is no {depth!r}; use one of {', '.join(_STORAGE)}")
    return _STORAGE[depth]


def as_materials(
    maps: ArrayLike, fresnel: Fresnel, eta: float, names: Sequence[str] | None = None
) -> dict[str, Material]:
    """The materials by name, if none are given material-00, ...; a single one is `material` then.

    Raises:
        UserError: maps that are no material (the message names the first), a reading of k_s that is none, or names
            that are not as many, or not of files.
    """
    bright = unit_reflectance(fresnel, eta)
    # A copy of arrays: torch warns of those that cannot be written to.
    x = maps.detach().cpu().float() if isinstance(maps, torch.Tensor) else torch.tensor(np.asarray(maps, np.float32))
    x = x[None] if x.dim() == 3 else x
    if not x.numel():
        raise UserError(f"maps: there is no material in an array of shape {tuple(x.shape)}; give (N, 8, H, W)")
    unpack_maps(x)
    if names is None:
        names = names_of(range(len(x)), "material-") if len(x) > 1 else ["material"]
    names = names_for(x, names)
    return {name: _material(check_maps(x[i : i + 1], name), bright) for i, name in enumerate(names)}


def _material(x: torch.Tensor, bright: float) -> Material:
    k_d, k_s, m, n = (value[0].permute(1, 2, 0).numpy() for value in unpack_maps(x).values())
    return Material(k_d, k_s * np.float32(bright), np.sqrt(m), n / np.linalg.norm(n, axis=-1, keepdims=True))


def unit_reflectance(fresnel: Fresnel, eta: float) -> float:
    """F0 where k_s is 1."""
    if fresnel not in get_args(Fresnel):
        raise UserError(f"fresnel: there is no reading {fresnel!r} of the specular albedo; use one of eta, albedo")
    if not 1 < eta < math.inf:
        raise UserError(f"eta is {eta}: give a refractive index above 1, such as 1.5")
    return 1.0 if fresnel == "albedo" else ((eta - 1) / (eta + 1)) ** 2


def write_maps(folder: Path, material: Material, storage: Storage, fresnel: Fresnel, eta: float) -> dict[str, Sheet]:
    """The four pictures and material.json into a folder; what was written, by the map's name."""
    sheets = {name: _picture(folder, name, value, storage) for name, value in material._asdict().items()}
    note = _note(material, sheets, fresnel, eta)
    save(folder / "material.json", json.dumps(note, indent=2, ensure_ascii=False) + "\n")
    return sheets


def _picture(folder: Path, name: str, values: np.ndarray, storage: Storage) -> Sheet:
    encoding = "sRGB" if name == "basecolor" and storage.suffix == "png" else "linear"
    sheet = Sheet(f"{name}.{storage.suffix}", storage.stored, encoding, scale_of(values, storage.largest))
    pixels = (values + 1) / 2 if name == "normal" else values / np.float32(sheet.scale)
    write_picture(folder / sheet.file, to_srgb(pixels) if encoding == "sRGB" else pixels, storage.stored)
    return sheet


def scale_of(values: np.ndarray, largest: float = 1) -> float:
    """1, or what the values must be divided by so that none is above `largest`."""
    return max(1.0, float(values.max()) / largest)


def to_srgb(linear: np.ndarray) -> np.ndarray:
    """The transfer curve of IEC 61966-2-1, of values in [0, 1]."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def _note(material: Material, sheets: dict[str, Sheet], fresnel: Fresnel, eta: float) -> dict[str, Any]:
    height, width, _ = material.basecolor.shape
    about = {name: {"quantity": _MEANING[name], **sheet._asdict()} for name, sheet in sheets.items()}
    for name in ("basecolor", "specular"):
        if getattr(material, name).shape[-1] == 3:
            about[name]["primaries"] = "Rec. 709, as sRGB"
    return {
        "format": _FORMAT,
        "width": width,
        "height": height,
        "rows": "row 0 is the top of the picture",
        "model": _MODEL,
        "fresnel": fresnel,
        "eta": eta,
        "F0_where_k_s_is_1": unit_reflectance(fresnel, eta),
        "decoding": "undo the encoding of the file's values, then multiply by the scale: the quantity, linear",
        "maps": about,
    }


def write_folders(
    materials: dict[str, Material],
    path: str | PathLike[str],
    write: Callable[[Path, Material], Any],
    numbered: bool = True,
) -> Written:
    """Let `write` fill a folder for each material, the folder itself for one; they appear when all are filled.

    Maps of an earlier export are removed from the folders that are written: in another format they would lie beside the
    new ones. Other materials in the folder are named in a warning, if these are `numbered`: all there are, from 0.
    """
    path = Path(path)
    if path.suffix in (".png", ".exr", ".json", ".mtlx") or (path.exists() and not path.is_dir()):
        raise UserError(f"{path}: a material is a folder of maps; give the name of a folder")
    several, beside = len(materials) > 1, [file.parent.name for file in sorted(path.glob("*/material.json"))]
    if (path / "material.json").is_file() if several else beside:
        held, given = ("a material", "several") if several else (f"several materials ({beside[0]}, …)", "one")
        raise UserError(f"{path}: holds {held}, which {given} beside it would hide; give another folder, or remove it")
    before = [folder for folder in ([path / name for name in materials] if several else [path]) if _is_ours(folder)]
    with filled_folder(path) as staging:
        for name, material in materials.items():
            folder = staging / name if several else staging
            folder.mkdir(exist_ok=True)
            write(folder, material)
        files = files_below(staging)
    written = tuple(path / file for file in files)
    for stale in {folder / name for folder in before for name in _OWN} - {*written}:
        if stale.is_file():
            stale.unlink()
    if several and numbered:  # chosen ones may be put beside others
        warn_left(path, [*materials], r"material-\d+")
    return Written(written)


def _is_ours(folder: Path) -> bool:
    """Whether a folder holds a material that was written before."""
    try:
        note = json.loads((folder / "material.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(note, dict) and note.get("format") == _FORMAT
