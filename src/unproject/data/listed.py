"""Pictures that are named one by one, not by the folder they lie in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from .._pictures import UnusablePicture, read_displayed
from .._types import UserError
from .collection import Collection
from .readers.framing import Framing, frame
from .readers.photographs import photograph
from .readers.pictures import SUFFIXES, unit_values


def read_silhouettes(files: Sequence[Path], size: int) -> Collection:
    """Read masks, cut-outs or photographs on a plain backdrop as silhouettes (N, 1, size, size), framed as folders are.

    Raises:
        UserError: naming the first file that cannot be used.
    """
    images = []
    for file in _checked(files):
        try:
            images.append(frame(unit_values(read_displayed(file, labels=True)), size, Framing()).image)
        except UnusablePicture as reason:
            raise UserError(f"{file}: {reason}; give another picture of it") from None
    return Collection(torch.stack(images), names=[str(file) for file in files], source=str(files[0]))


def read_photographs(
    files: Sequence[Path], size: int, name: str = "photograph", *, coloured: bool = False
) -> Collection:
    """Read photographs of flat materials, or maps of them (N, C, size, size): the largest centred square of each.

    Args:
        files: the pictures.
        size: pixels a side.
        name: the map that they are, decoded as in training; any other name is of photographs.
        coloured: read three channels of specular maps (default: their mean).

    Raises:
        UserError: naming the first file that cannot be used.
    """
    images = torch.stack([photograph(file, name, size, coloured) for file in _checked(files)])
    return Collection(images, names=[str(file) for file in files], source=str(files[0]))


def are_pictures(paths: Sequence[Path], suffixes: Sequence[str] = SUFFIXES) -> bool:
    """Whether these are files of pictures, not folders or arrays."""
    return all(path.suffix.lower() in suffixes and not path.is_dir() for path in paths)


def _checked(files: Sequence[Path]) -> Sequence[Path]:
    for file in files:
        if not file.is_file():
            raise UserError(f"{file}: there is no such file; check the path")
    return files
