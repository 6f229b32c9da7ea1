"""Which reader a path is for."""

from __future__ import annotations

import os
from pathlib import Path

from ..._files import files_with
from ..._types import UserError
from .arrays import read_arrays
from .found import Found, check_size
from .options import ReadOptions
from .pictures import SAVE, UNREAD, read_pictures
from .pictures import SUFFIXES as PICTURES
from .shapes import SUFFIXES as SHAPES
from .shapes import find_volumes, is_shape_archive, split_selector


def find(path: str | os.PathLike[str], options: ReadOptions) -> Found:
    """Read a path with the reader of its kind.

    Raises:
        UserError: if nothing is there, or no reader knows it.
    """
    path = Path(path)
    check_size(path, options.size)
    file, selector = split_selector(path)
    if path.is_dir():
        if holds_shapes(path):
            return find_volumes(path, options.size, strict=options.strict)
        return read_pictures(path, options)
    if not file.exists():
        raise UserError(f"{path}: there is no such file or folder; check the path")
    if selector or file.suffix.lower() in SHAPES or is_shape_archive(file):
        return find_volumes(path, options.size, strict=options.strict)
    if file.suffix.lower() in PICTURES:
        raise UserError(f"{path}: is one picture; name the folder it lies in")
    if file.suffix.lower() in UNREAD:
        raise UserError(f"{path}: {file.suffix} is not read; {SAVE}, into a folder")
    return read_arrays(file, options)


def holds_shapes(path: Path) -> bool:
    """Whether a folder has files of shapes; pictures in a sub-folder of a shape are its textures.

    Raises:
        UserError: if there are other pictures too.
    """
    shapes = files_with(path, SHAPES)
    around = {shape.parent for shape in shapes} - {path}
    pictures = [file for file in files_with(path, PICTURES) if not around & set(file.parents)] if shapes else []
    if pictures:
        raise UserError(f"{path}: holds shapes ({shapes[0]}) and pictures ({pictures[0]}); name a folder of one kind")
    return bool(shapes)
