"""What a path will be used as by the recipes of materials, and whether it is for them at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from .._files import files_with, paths_below
from .._types import UserError
from ..ops.maps import MAPS
from .collection import Collection
from .inspection import FileRow, Inspection
from .readers.exported import exported_note
from .readers.found import check_size
from .readers.lights import (
    KINDS,
    MAX_NAMED,
    SAVE,
    SUFFIXES,
    UNREAD,
    photographed,
    refuse_unsorted,
    showing,
    sub_folder,
    unsorted,
)
from .readers.patches import material_patches, side_to_cut_from
from .readers.shapes import SUFFIXES as SHAPES
from .readers.sides import size_of_picture
from .readers.stored import StoredArrays
from .readers.texture_maps import Convention
from .readers.texture_names import find_textures, picture_names, sets_in
from .readers.textures import material_folders, pictures_of_no_map

PATCHES = 64
FEWER_ABOVE = 512
"""Patches of more pixels a side are fewer, for the same memory."""
UNCLEAR = frozenset({"top", "normal", "lamp", "overhead"})
"""Sub-folders that silhouettes may lie in too: views, and classes of objects."""
MOST_MAPS = 32
"""Pictures of a texture set at most."""


def inspect_materials(path: Path | str, size: int, *, strict: bool = False) -> Inspection:
    """Read a path as the recipes of materials do: pictures of each observation, or patches of texture sets.

    Raises:
        UserError: if there is nothing there that can be used.
    """
    path = Path(path)
    check_size(path, size)
    names = photographed(path)
    if names:
        found = {name: Collection.photographs(path, name, size, strict=strict) for name in names}
        return _of_photographs(path, found, size)
    refuse_unsorted(path)
    return _of_textures(path, size, strict)


def _of_textures(path: Path, size: int, strict: bool) -> Inspection:
    side = None if path.suffix.lower() == ".npz" else side_to_cut_from(size)
    whole = Collection.materials(path, side, convention=Convention(fresnel="albedo"), strict=strict)
    count = max(1, min(PATCHES, PATCHES * FEWER_ABOVE**2 // size**2))
    cut = whole if whole.shape[-2:] == (size, size) else Collection(material_patches(whole.items, count, size))
    texels = pixels((whole.shape[-1], whole.shape[-2]))
    rows = [FileRow(name, skipped=reason.removeprefix(f"{path / name}: ")) for name, reason in whole.skipped]
    notes = [f"materials: {len(whole)} of {texels} texels: diffuse, specular, roughness and normal maps"]
    sizes: dict[str, str] = {}
    if side is not None:
        places = material_folders(path)
        rows += [
            FileRow(file.relative_to(path).as_posix(), skipped=f"{file.suffix} is not read; {SAVE}")
            for file in files_with(path, UNREAD)
        ]
        stray = pictures_of_no_map(path, places)
        rows += [FileRow(file.relative_to(path).as_posix(), skipped="its name is no map's") for file in stray]
        stored = {name: _stored_size(*places[name]) for name in whole.names}
        sizes = {name: pixels(own) for name, own in stored.items() if own is not None}
        small = [name for name, own in stored.items() if own is not None and min(own) < side]
        if small:
            notes.append(f"{len(small)} of them are smaller and were enlarged: {', '.join(small[:MAX_NAMED])}")
    rows += [FileRow(name, sizes.get(name, texels), "material") for name in whole.names]
    if cut is not whole:
        shape = " x ".join(map(str, cut.shape))
        notes.append(f"patches: {len(cut)} of {shape}, cut out of them at any place and angle, as in training")
    kind = "materials" if cut is whole else "patches"
    return Inspection(str(path), {kind: cut}, tuple(rows), tuple(notes), whole)


def _stored_size(folder: Path, files: Sequence[Path] | None) -> tuple[int, int] | None:
    """Return the size of a material's colour map; None of what `unproject export` wrote, whose note says its files."""
    if exported_note(folder) is not None:
        return None
    return size_of_picture(find_textures(folder, of=files).files["colour"])


def _of_photographs(path: Path, found: Mapping[str, Collection], size: int) -> Inspection:
    skipped = [FileRow(name, skipped=reason) for one in found.values() for name, reason in one.skipped]
    skipped += [FileRow(file.relative_to(path).as_posix(), skipped=why) for file, why in unsorted(path).items()]
    used: list[FileRow] = []
    notes = []
    for kind, one in found.items():
        sizes = {name: size_of_picture(path / name) for name in one.names}
        used += [FileRow(name, pixels(side), f"picture of {kind}") for name, side in sizes.items()]
        what = f"photographs, lit by {KINDS[kind].light}" if kind in KINDS else "maps"
        known = [side for side in sizes.values() if side is not None]
        notes.append(f"{kind}: {len(one)} {what}" + (f"; {_range(known)}" if known else ""))
    notes.append(f"of each the largest centred square is used, at {size} x {size} pixels")
    return Inspection(str(path), found, (*skipped, *used), (*notes, *showing([*found])))


def pixels(size: tuple[int, int] | None) -> str:
    """Return "width x height"; "" if they are not known."""
    return "" if size is None else f"{size[0]} x {size[1]}"


def _range(sizes: Sequence[tuple[int, int]]) -> str:
    """Return the smallest and the largest size, by the shorter side."""
    least, most = (choose(sizes, key=min, default=None) for choose in (min, max))
    return f"{pixels(least)} pixels" if least == most else f"{pixels(least)} to {pixels(most)} pixels"


def holds_materials(path: Path | str) -> bool:
    """Whether a path clearly holds materials: sub-folders named by maps or lights, texture sets, or an .npz of maps.

    Sub-folders that silhouettes may lie in too, such as `top`, say nothing alone; nor do textures of meshes.
    """
    path = Path(path)
    if path.suffix.lower() == ".npz":
        return _holds_maps(path)
    if not path.is_dir():
        return False
    if any(
        files_with(sub_folder(path, name) or path / name, (*SUFFIXES, *UNREAD))
        for name in photographed(path)
        if name not in UNCLEAR
    ):
        return True
    return not any(file.suffix.lower() in SHAPES for file in paths_below(path)) and holds_textures(path)


def holds_textures(path: Path) -> bool:
    """Whether a folder is a texture set, or one is below it."""
    return any(_is_texture_set(folder) for folder in (path, *paths_below(path)) if folder.is_dir())


def _holds_maps(path: Path) -> bool:
    try:
        return path.is_file() and {*MAPS} <= {*StoredArrays(path).shapes}
    except Exception:  # whatever zipfile and NumPy raise at damaged files, of which the reader says what is wrong
        return False


def _is_texture_set(folder: Path) -> bool:
    """Whether there is one picture for each map, a colour and a roughness map among them, or several such sets."""
    if sets_in(folder):
        return True
    if not 2 <= len(picture_names(folder)) <= MOST_MAPS:
        return False
    try:
        find_textures(folder)
    except UserError:
        return False
    return True
