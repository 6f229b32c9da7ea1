"""Join the pictures of a figure's arms into one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from .._files import atomic_path
from .claim_results import Report

LABEL, GAP, WIDEST = 22, 12, 1600
"""Height of a label, space between two pictures, and width of the whole, in pixels."""


def save_picture(report: Report, path: Path) -> bool:
    """Save pictures of true samples and of each arm's first seed under their names; return False if there are none."""
    sheets = {name: sheet for name, sheet in _sheets(report).items() if sheet.exists()}
    if not sheets:
        return False
    with atomic_path(path) as temporary:
        _together(sheets).save(temporary)
    return True


def _sheets(report: Report) -> dict[str, Path]:
    """Return name → picture, in the order of the arms; training images of real collections are not shown."""
    sheets: dict[str, Path] = {}
    samples = report.figure.shows == "samples"
    for arm in (*report.figure.arms, *(report.figure.real if samples else ())):
        truth = f"truth-{arm.source}"
        if samples and truth in report.truths:
            sheets[truth] = report.truths[truth].picture
        for seed in report.seeds(arm.name)[:1]:
            result = report.results[arm.name, seed]
            sheets[arm.name] = result.picture if samples else result.views
    return sheets


Row = list[tuple[str, Image.Image]]


def _together(paths: Mapping[str, Path]) -> Image.Image:
    """Return the pictures under their names, in rows no wider than WIDEST."""
    rows = _rows(paths)
    heights = [LABEL + max(picture.height for _, picture in row) for row in rows]
    sheet = Image.new("RGB", (max(map(_width, rows)), sum(heights)), "white")
    top = 0
    for row, height in zip(rows, heights, strict=True):
        _paste(sheet, row, top)
        top += height
    return sheet


def _rows(paths: Mapping[str, Path]) -> list[Row]:
    rows: list[Row] = [[]]
    for name, path in paths.items():
        with Image.open(path) as stored:
            picture = stored.convert("RGB")
        picture.thumbnail((WIDEST, picture.height))
        if rows[-1] and _width([*rows[-1], (name, picture)]) > WIDEST:
            rows.append([])
        rows[-1].append((name, picture))
    return rows


def _paste(sheet: Image.Image, row: Row, top: int) -> None:
    draw, font, left = ImageDraw.Draw(sheet), ImageFont.load_default(size=14), 0
    for name, picture in row:
        draw.text((left + 2, top + 3), name, "black", font)
        sheet.paste(picture, (left, top + LABEL))
        left += picture.width + GAP


def _width(row: Sequence[tuple[str, Image.Image]]) -> int:
    return sum(picture.width + GAP for _, picture in row) - GAP
