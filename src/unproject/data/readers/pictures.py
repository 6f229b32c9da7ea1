"""Folders of pictures: masks, RGBA cut-outs, photographs on a plain backdrop; or pictures as they are.

Files are taken recursively and in the order of their names. One that cannot be used is named and skipped. A file
`views.csv` beside the pictures makes the views known.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, TypeVar

import numpy as np
import torch
from torch import Tensor

from ..._pictures import UnusablePicture, read_displayed
from ..._types import UserError
from .found import Found, to_bytes
from .framing import Framed, Framing, frame
from .how import How
from .images import as_images
from .views import views_beside

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")
SIZE = 64

T = TypeVar("T")


@dataclass(frozen=True)
class Survey(Generic[T]):
    """What each picture of a folder became, or why it cannot be used."""

    used: dict[str, T] = field(default_factory=dict)
    skipped: dict[str, str] = field(default_factory=dict)


def read_pictures(path: Path, how: How) -> Found:
    """Read a folder's pictures: silhouettes (N, 1, size, size), 64 by default; or images, as stored by default.

    Raises:
        UserError: if there is no folder, no picture, none that can be used, with `strict` one that cannot, or
            if `views.csv` does not fit.
    """
    return _images(path, how) if how.images else silhouettes_of(path, survey_silhouettes(path, how))


def survey_silhouettes(path: Path, how: How) -> Survey[Framed]:
    """Frame every picture of a folder."""
    size, framing = how.size or SIZE, how.framing or Framing()
    return _survey(path, lambda file: frame(unit_values(read_displayed(file)), size, framing), how.strict)


def silhouettes_of(path: Path, survey: Survey[Framed]) -> Found:
    """The coverage (N, 1, size, size) of framed pictures, in 8 bits."""
    _check_used(path, survey)
    return _found(path, survey, to_bytes(torch.stack([framed.image for framed in survey.used.values()])), 255)


def _images(path: Path, how: How) -> Found:
    def read(file: Path) -> Tensor:
        pixels = torch.from_numpy(np.moveaxis(read_displayed(file), 2, 0).copy())
        return as_images(pixels[None], how.size, how.colour)[0]

    survey = _survey(path, read, how.strict)
    _check_used(path, survey)
    _check_sizes(path, survey)
    images = [*survey.used.values()]
    if any(image.is_floating_point() for image in images):
        images = [image / 255 if image.dtype == torch.uint8 else image for image in images]
    return _found(path, survey, torch.stack(images), 255 if images[0].dtype == torch.uint8 else 1)


def _survey(path: Path, read: Callable[[Path], T], strict: bool) -> Survey[T]:
    survey: Survey[T] = Survey()
    for file in picture_files(path):
        name = file.relative_to(path).as_posix()
        try:
            survey.used[name] = read(file)
        except UnusablePicture as reason:
            if strict:
                raise UserError(f"{file}: {reason}; fix or remove it, or leave out --strict") from None
            survey.skipped[name] = str(reason)
    return survey


def _check_used(path: Path, survey: Survey[T]) -> None:
    if not survey.used:
        name, reason = next(iter(survey.skipped.items()))
        raise UserError(
            f"{path}: none of the {len(survey.skipped)} pictures can be used ({name}: {reason}); "
            f"see `unproject data inspect {path}`, or change the threshold"
        )


def _check_sizes(path: Path, survey: Survey[Tensor]) -> None:
    sizes = {tuple(image.shape[1:]): name for name, image in reversed(survey.used.items())}
    if len(sizes) > 1:
        listed = ", ".join(f"{name} {width} x {height}" for (height, width), name in [*sizes.items()][:2])
        raise UserError(f"{path}: pictures are of different sizes ({listed}); give a size to bring them to")


def _found(path: Path, survey: Survey[T], items: Tensor, white: int) -> Found:
    names = tuple(survey.used)
    latents = views_beside(path, names, tuple(survey.skipped))
    return Found(items, names, latents, tuple(survey.skipped.items()), str(path), white)


def picture_files(path: Path) -> list[Path]:
    """The pictures in a folder and its subfolders, sorted; hidden files are no pictures."""
    if not path.is_dir():
        raise UserError(f"{path}: there is no such folder; check the path")
    files = sorted(file for file in path.rglob("*") if _is_picture(file.relative_to(path)) and file.is_file())
    if not files:
        raise UserError(f"{path}: holds no picture; put {', '.join(s[1:] for s in SUFFIXES)} files there")
    return files


def _is_picture(path: Path) -> bool:
    return path.suffix.lower() in SUFFIXES and not any(part.startswith((".", "__")) for part in path.parts)


def unit_values(pixels: np.ndarray) -> np.ndarray:
    """float32 in [0, 1] of uint8 pixels; floats as they are."""
    return pixels.astype(np.float32) / 255 if pixels.dtype == np.uint8 else pixels
