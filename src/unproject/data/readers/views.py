"""Known views of a folder's pictures: `views.csv`, a header `file,azimuth[,elevation]`, degrees, one row a picture."""

from __future__ import annotations

import csv
import math
import unicodedata
import warnings
from collections.abc import Sequence
from pathlib import Path

import torch
from torch import Tensor

from ..._types import UserError
from .lines import MAX_ANGLE

VIEWS = "views.csv"


def views_beside(folder: Path, names: Sequence[str], skipped: Sequence[str]) -> dict[str, Tensor] | None:
    """The views of a folder's pictures; None if it has no `views.csv`, in whatever case."""
    below = (file for file in sorted(folder.iterdir()) if file.name.lower() == VIEWS and file.is_file())
    file = folder / VIEWS if (folder / VIEWS).is_file() else next(below, None)
    if file is not None:
        return read_views(file, names, skipped)
    deeper = next((folder / part / VIEWS for part in sorted({*map(_folder_of, names)}) if part), None)
    if deeper is not None and deeper.is_file():
        warnings.warn(
            f"{deeper}: is not read; put one table beside the folders, file being the path below", stacklevel=2
        )
    return None


def _folder_of(name: str) -> str:
    return name.rpartition("/")[0]


def read_views(file: Path, names: Sequence[str], skipped: Sequence[str] = ()) -> dict[str, Tensor]:
    """Read the views of these pictures in radians, name of the latent → (N,), from a table in degrees.

    Raises:
        UserError: naming the line, if the table has no header, a row has no such file or no number, a file
            has two rows, or a picture has none.
    """
    columns, rows = _read_table(file)
    views: dict[str, list[float]] = {}
    there = {unicodedata.normalize("NFC", name): name for name in (*skipped, *names)}  # systems spell é in two ways
    for line, row in rows:
        said, angles = _read_row(file, line, row, columns)
        name = there.get(unicodedata.normalize("NFC", said), said)
        if name in views:
            raise UserError(f"{file}, line {line}: {name} has a row already; keep one")
        if unicodedata.normalize("NFC", name) not in there:
            raise UserError(
                f"{file}, line {line}: there is no picture {name} beside it; fix the name or remove the row"
            )
        views[name] = angles
    missing = [name for name in names if name not in views]
    if missing:
        raise UserError(
            f"{file}: {len(missing)} pictures have no row, the first is {missing[0]}; "
            "add them, or remove views.csv if views are unknown"
        )
    degrees = torch.tensor([views[name] for name in names], dtype=torch.float64)
    if degrees.abs().max() <= 2 * math.pi and bool((degrees % 1).any()):
        warnings.warn(f"{file}: no angle is beyond 6.3; they are taken for degrees, not for radians", stacklevel=2)
    return {column: degrees[:, k].deg2rad().float() for k, column in enumerate(columns)}


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
    if not all(abs(angle) <= MAX_ANGLE for angle in degrees):
        raise UserError(f"{file}, line {line}: {','.join(row[1:])!r} is no angle; give degrees as numbers")
    if len(degrees) > 1 and abs(degrees[1]) > 90:
        raise UserError(f"{file}, line {line}: an elevation of {degrees[1]:g} degrees is beyond a pole; give -90 to 90")
    return row[0].replace("\\", "/"), degrees
