"""Folders of pictures: masks, RGBA cut-outs, photographs on a plain backdrop.

Files are taken recursively and in the order of their names. One that cannot be used is named and skipped. A file
`views.csv` beside the pictures makes the views known: a header `file,azimuth[,elevation]`, degrees, one row a picture.
"""

from __future__ import annotations

import csv
import math
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageOps, UnidentifiedImageError
from torch import Tensor

from ..._types import UserError
from ..records import Records
from .framing import Framed, Framing, UnusablePicture, frame

SUFFIXES = (".png", ".jpg", ".jpeg", ".webp", ".bmp", ".tif", ".tiff")
VIEWS = "views.csv"
SIZE = 64


@dataclass(frozen=True)
class Survey:
    """What became of every picture of a folder."""

    framed: dict[str, Framed]
    skipped: dict[str, str]


def read_folder(path: Path, size: int | None = None, framing: Framing | None = None, strict: bool = False) -> Records:
    """Framed pictures (N, 1, size, size), 64 unless given, and their views if there is a `views.csv`.

    Raises:
        UserError: if there is no folder, no picture, none that can be used, with `strict` one that cannot, or
            if `views.csv` does not fit.
    """
    survey = survey_folder(path, size or SIZE, framing or Framing(), strict)
    if not survey.framed:
        name, reason = next(iter(survey.skipped.items()))
        raise UserError(
            f"{path}: none of the {len(survey.skipped)} pictures can be used ({name}: {reason}); "
            f"look with `unproject data inspect {path}`, or change the threshold"
        )
    names = tuple(survey.framed)
    views = path / VIEWS
    latents = read_views(views, names, tuple(survey.skipped)) if views.is_file() else None
    images = torch.stack([framed.image for framed in survey.framed.values()])
    return Records.from_tensor(images, latents, names, tuple(survey.skipped.items()), str(path))


def survey_folder(path: Path, size: int, framing: Framing, strict: bool = False) -> Survey:
    """Frame every picture of a folder, and say why each that cannot be used cannot."""
    survey = Survey({}, {})
    for file in picture_files(path):
        name = file.relative_to(path).as_posix()
        try:
            survey.framed[name] = frame(read_picture(file), size, framing)
        except UnusablePicture as reason:
            if strict:
                raise UserError(f"{file}: {reason}; mend or remove it, or leave out --strict") from None
            survey.skipped[name] = str(reason)
    return survey


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


def read_picture(file: Path) -> np.ndarray:
    """A picture as (H, W, C) float32 in [0, 1], C = 1 to 4, turned as its camera says.

    Raises:
        UnusablePicture: if it cannot be read, or is so large that Pillow takes it for a decompression bomb.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            with Image.open(file) as picture:
                return _values(ImageOps.exif_transpose(picture))
    except (Image.DecompressionBombError, Image.DecompressionBombWarning):
        raise UnusablePicture(f"too large: over {Image.MAX_IMAGE_PIXELS} pixels; make it smaller") from None
    except UnidentifiedImageError:
        raise UnusablePicture("unreadable: no picture of a known format") from None
    except (OSError, SyntaxError, ValueError, EOFError, MemoryError, TypeError, IndexError) as error:
        raise UnusablePicture(f"unreadable: {_reason(error)}") from None


def _reason(error: BaseException) -> str:
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return " ".join(text.split()) or type(error).__name__


def _values(picture: Image.Image) -> np.ndarray:
    if picture.mode.startswith(("I", "F")):
        return _deep_values(picture)
    transparent = "A" in picture.getbands() or "transparency" in picture.info
    grey = picture.mode in ("1", "L", "LA")
    mode = ("LA" if grey else "RGBA") if transparent else ("L" if grey else "RGB")
    values = np.asarray(picture.convert(mode), dtype=np.float32) / 255
    return values[..., None] if values.ndim == 2 else values


def _deep_values(picture: Image.Image) -> np.ndarray:
    """16-bit integers are shares of 65535, as PNG and TIFF mean them; floats are as they are."""
    values = np.asarray(picture, dtype=np.float32)[..., None]
    if not np.isfinite(values).all():
        raise UnusablePicture("unreadable: has values that are NaN or infinite")
    return np.clip(values / (1.0 if picture.mode == "F" else 65535.0), 0, 1)


def read_views(file: Path, names: tuple[str, ...], skipped: tuple[str, ...] = ()) -> dict[str, Tensor]:
    """The views of these pictures in radians, name of the latent → (N,), from a table in degrees.

    Raises:
        UserError: naming the line, if the table has no header, a row has no such file or no number, a file
            has two rows, or a picture has none.
    """
    columns, rows = _read_table(file)
    views: dict[str, list[float]] = {}
    for line, row in rows:
        name, degrees = _read_row(file, line, row, columns)
        if name in views:
            raise UserError(f"{file}, line {line}: {name} has a row already; keep one")
        if name not in names and name not in skipped:
            raise UserError(
                f"{file}, line {line}: there is no picture {name} beside it; mend the name or remove the row"
            )
        views[name] = degrees
    missing = [name for name in names if name not in views]
    if missing:
        raise UserError(
            f"{file}: {len(missing)} pictures have no row, the first is {missing[0]}; "
            "add them, or remove views.csv if views are unknown"
        )
    table = torch.tensor([views[name] for name in names], dtype=torch.float64) * (math.pi / 180)
    return {column: table[:, k].float() for k, column in enumerate(columns)}


def _read_table(file: Path) -> tuple[list[str], list[tuple[int, list[str]]]]:
    """The columns beside `file`, and (line number, cells) of each row."""
    try:
        with file.open(newline="", encoding="utf-8-sig") as text:
            reader = csv.reader(text)
            rows = [(reader.line_num, [cell.strip() for cell in row]) for row in reader if any(map(str.strip, row))]
    except (UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{file}: cannot be read as a table ({error}); save it as CSV in UTF-8") from None
    header = rows[0][1] if rows else []
    if header not in (["file", "azimuth"], ["file", "azimuth", "elevation"]):
        raise UserError(
            f"{file}, line 1: the header is file,azimuth or file,azimuth,elevation, not {','.join(header)!r}"
        )
    return header[1:], rows[1:]


def _read_row(file: Path, line: int, row: list[str], columns: list[str]) -> tuple[str, list[float]]:
    if len(row) != 1 + len(columns):
        raise UserError(f"{file}, line {line}: has {len(row)} cells; give {1 + len(columns)}: file,{','.join(columns)}")
    try:
        degrees = [float(cell) for cell in row[1:]]
    except ValueError:
        degrees = [math.nan]
    if not all(map(math.isfinite, degrees)):
        raise UserError(f"{file}, line {line}: {','.join(row[1:])!r} is no angle; give degrees as numbers")
    return row[0].replace("\\", "/"), degrees
