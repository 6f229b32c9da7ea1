"""What a path will be used as: a table of every picture and a contact sheet."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from PIL import Image
from torch import Tensor

from .collection import Collection, check_size, holds_only_shapes
from .readers.framing import Framing
from .readers.pictures import SIZE, VIEWS, read_views, survey_folder
from .records import Records

Row = tuple[str, str, str, str]


@dataclass(frozen=True)
class Inspection:
    """What is used of a path, and what is not.

    Attributes:
        source: the path.
        collection: what a training run would get; None if nothing can be used.
        rows: (name, size, how it was read, "used" or why it was skipped), one a file or item.
    """

    source: str
    collection: Records | None
    rows: tuple[Row, ...]

    @property
    def skipped(self) -> tuple[Row, ...]:
        """The rows of what cannot be used."""
        return tuple(row for row in self.rows if row[3] != "used")

    def table(self, limit: int = 20) -> str:
        """Text: first what was skipped and why, then how the rest was read, then the totals."""
        used = [row for row in self.rows if row[3] == "used"]
        shown = [*self.skipped[:limit], *used[:limit]]
        widths = [max(len(row[k]) for row in shown) for k in range(3)]
        lines = ["  ".join((*(cell.ljust(w) for cell, w in zip(row, widths, strict=False)), row[3])) for row in shown]
        left = len(self.rows) - len(shown)
        return "\n".join([*lines, *([f"... and {left} more"] if left else []), "", *self.summary()])

    def summary(self) -> list[str]:
        """The totals, a line each."""
        used = len(self.rows) - len(self.skipped)
        how = Counter(row[2] for row in self.rows if row[3] == "used")
        lines = [f"{self.source}: {used} used, {len(self.skipped)} skipped"]
        lines += [f"  {count} read as {name}" for name, count in how.most_common()]
        if self.collection is not None:
            views = ", ".join(self.collection.latents) if self.collection.latents else "unknown"
            lines.append(f"  each becomes {' x '.join(map(str, self.collection.items.shape[1:]))}; views: {views}")
        return lines

    def as_dict(self) -> dict[str, Any]:
        """The same for JSON."""
        found = self.collection
        return {
            "source": self.source,
            "used": len(self.rows) - len(self.skipped),
            "shape": None if found is None else list(found.items.shape),
            "views": None if found is None or found.latents is None else list(found.latents),
            "skipped": [{"name": row[0], "reason": row[3]} for row in self.skipped],
            "files": [{"name": row[0], "size": row[1], "read_as": row[2]} for row in self.rows if row[3] == "used"],
        }


def inspect(
    path: Path | str, *, size: int | None = None, framing: Framing | None = None, strict: bool = False
) -> Inspection:
    """Read a path as training would, and say what becomes of each part.

    Raises:
        UserError: if there is nothing to look at; pictures that cannot be used are rows, not errors.
    """
    path = Path(path)
    check_size(path, size)
    if path.is_dir() and not holds_only_shapes(path):
        return _inspect_folder(path, size or SIZE, framing or Framing(), strict)
    found = Collection(path, size=size, framing=framing, strict=strict)
    kind = "line" if found.items.ndim == 3 else "volume" if found.items.shape[1] > 4 else "picture"
    shape = " x ".join(map(str, found.items.shape[1:]))
    rows = [(name, "", "", reason) for name, reason in found.skipped]
    return Inspection(str(path), found, (*rows, *((name, shape, kind, "used") for name in found.names)))


def _inspect_folder(path: Path, size: int, framing: Framing, strict: bool) -> Inspection:
    survey = survey_folder(path, size, framing, strict)
    rows: list[Row] = [(name, "", "", reason) for name, reason in survey.skipped.items()]
    for name, framed in survey.framed.items():
        how = "alpha" if framed.channel == "alpha" else f"{framed.channel} on {framed.background} background"
        rows.append((name, f"{framed.width} x {framed.height}", how, "used"))
    if not survey.framed:
        return Inspection(str(path), None, tuple(rows))
    views = path / VIEWS
    names = tuple(survey.framed)
    latents = read_views(views, names, tuple(survey.skipped)) if views.is_file() else None
    images = torch.stack([framed.image for framed in survey.framed.values()])
    return Inspection(str(path), Records.from_tensor(images, latents, names, source=str(path)), tuple(rows))


def contact_sheet(collection: Records, count: int = 64, columns: int = 8, cell: int = 96) -> Image.Image:
    """Up to `count` items, evenly spread over the collection, side by side on grey; volumes seen from azimuth 0."""
    rows = torch.linspace(0, len(collection) - 1, min(count, len(collection))).round().long().unique()
    columns = min(columns, len(rows))
    sheet = Image.new("L", (columns * cell, math.ceil(len(rows) / columns) * cell), 128)
    for k, row in enumerate(rows.tolist()):
        tile = Image.fromarray((_picture(collection.items[row]) * 255).round().byte().numpy())
        scale = (cell - 4) / max(tile.size)
        fit = (max(round(tile.width * scale), 1), max(round(tile.height * scale), 1))
        tile = tile.resize(fit, Image.Resampling.BOX if scale < 1 else Image.Resampling.NEAREST)
        sheet.paste(tile, (k % columns * cell + 2, k // columns * cell + 2))
    return sheet


def _picture(item: Tensor) -> Tensor:
    """(H, W) of a picture (C, H, W), of a volume (X, Y, Z) seen along z, or of a line (C, D) as a graph."""
    if item.ndim == 2:
        heights = item.mean(0) / item.max().clamp_min(1e-12)
        return (heights > 1 - (torch.arange(item.shape[1])[:, None] + 0.5) / item.shape[1]).float()
    if len(item) <= 4:
        return item.mean(0).clamp(0, 1)
    return item.amax(2).T.flip(0).clamp(0, 1)
