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
            images.append(frame(unit_values(read_displayed(file)), size, Framing()).image)
        except UnusablePicture as reason:
            raise UserError(f"{file}: {reason}; give another picture of it") from None
    return Collection(torch.stack(images), names=[str(file) for file in files], source=str(files[0]))


def read_photographs(files: Sequence[Path], size: int) -> Collection:
    """Read photographs of flat materials (N, 3, size, size): the largest centred square of each.

    Raises:
        UserError: naming the first file that cannot be used.
    """
    images = torch.stack([photograph(file, "photograph", size) for file in _checked(files)])
    return Collection(images, names=[str(file) for file in files], source=str(files[0]))


def are_pictures(paths: Sequence[Path]) -> bool:
    """Whether these are files of pictures, not folders or arrays."""
    return all(path.suffix.lower() in SUFFIXES and not path.is_dir() for path in paths)


def _checked(files: Sequence[Path]) -> Sequence[Path]:
    for file in files:
        if not file.is_file():
            raise UserError(f"{file}: there is no such file; check the path")
    return files
