"""Pictures of a run as data: URIs: samples now and over time, and training pictures."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from .. import export
from ..assignment import Panel
from ..domains import Domain
from ..training.seen import sheet_as_seen

WIDEST = 640
"""Pixels of a picture at most: of a column on a wide screen."""
SHAPES, MATERIALS, SHOWN_DATA = 16, 8, 24
QUALITY = 82


class Picture(NamedTuple):
    """A picture as a data: URI, with its size in pixels and what it shows."""

    uri: str
    width: int
    height: int
    says: str


def picture_of(image: Image.Image, says: str, widest: int = WIDEST, quality: int = QUALITY) -> Picture:
    """Return a picture as WebP, reduced to at most `widest` pixels a side."""
    image = image.convert("RGB")
    scale = widest / max(image.size)
    if scale < 1:
        size = max(round(image.width * scale), 1), max(round(image.height * scale), 1)
        image = image.resize(size, Image.Resampling.LANCZOS)
    content = io.BytesIO()
    image.save(content, "WEBP", quality=quality, method=4)
    uri = "data:image/webp;base64," + base64.b64encode(content.getvalue()).decode()
    return Picture(uri, image.width, image.height, says)


def samples_now(domain: Domain, x: Tensor) -> Picture:
    """Return samples in a grid: shapes one view each, all else as the domain previews it."""
    if domain.name == "volume" and x.dim() == 4:
        return picture_of(export.gallery(x[:SHAPES], size=144, columns=4), f"{min(len(x), SHAPES)} shapes")
    return picture_of(domain.preview(x[: domain.previewed]), f"{min(len(x), domain.previewed)} samples")


def over_time(previews: Sequence[tuple[int, Path]], most: int) -> tuple[list[tuple[int, Picture]], int]:
    """Return (step, picture) of at most so many previews, the first and the last among them; and how many are damaged.

    Those in between are evenly far apart in the logarithm of the step, as samples change.
    """
    shown, damaged = [], 0
    for step, file in _spread(previews, most):
        try:
            with Image.open(file) as opened:
                shown.append((step, picture_of(opened, f"samples at step {step}", quality=70)))
        except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
            damaged += 1
    return shown, damaged


def _spread(previews: Sequence[tuple[int, Path]], most: int) -> list[tuple[int, Path]]:
    if len(previews) <= most:
        return list(previews)
    steps = np.log([max(step, 1) for step, _ in previews])
    wanted = np.linspace(steps[0], steps[-1], most)
    rows = {int(np.abs(steps - at).argmin()) for at in wanted}
    return [previews[row] for row in sorted(rows | {0, len(previews) - 1})]


def training_pictures(panels: Sequence[Panel]) -> list[tuple[str, Picture]]:
    """Return (observation names, picture) of up to 24 training pictures a panel, evenly from its collections."""
    return [(_names(panel), picture_of(_sheet(panel), f"training pictures of {_names(panel)}")) for panel in panels]


def _names(panel: Panel) -> str:
    names = [observation.name for observation in panel.observations]
    return names[0] if len(names) == 1 else f"{names[0]} … {names[-1]}"


def _sheet(panel: Panel) -> Image.Image:
    count = min(SHOWN_DATA, len(panel))
    return sheet_as_seen(panel.projection, panel.batch((torch.arange(count) * len(panel)) // count), 6, 96)
