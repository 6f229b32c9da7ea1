"""Draw docs/images/how-projections.webp: silhouettes, radiographs, line integrals and renderings, a row each.

python tools/projections_figure.py
"""

from __future__ import annotations

import math
from pathlib import Path

import torch
from PIL import Image
from torch import Tensor

import unproject as up
from unproject.export import picture_sheet
from unproject.ops.microfacet import Reflection

OUT = Path(__file__).parent.parent / "docs" / "images" / "how-projections.webp"
CELL = 96
COLUMNS = 8


def shapes() -> tuple[Tensor, Tensor]:
    """Silhouettes and radiographs of a chair from eight azimuths."""
    volumes = up.data.chairs(1, 64, seed=1).expand(COLUMNS, -1, -1, -1)
    azimuth = torch.arange(COLUMNS) * math.pi / COLUMNS
    silhouettes = 1 - up.Silhouette()(volumes, azimuth=azimuth, elevation=torch.zeros(COLUMNS))
    thickness = up.ops.rotate_y(volumes, azimuth).mean(3).transpose(1, 2).flip(1)[:, None]
    return silhouettes, (-3 * thickness).exp()


def lines() -> Tensor:
    """Digits, each followed by its sinogram."""
    digits = up.data.digits(32)[: COLUMNS // 2]
    angle = torch.arange(32) * math.pi / 32
    sums = up.LineIntegral()(digits.repeat_interleave(32, 0), angle=angle.repeat(len(digits)))
    sinograms = sums.view(-1, 1, 32, 32).transpose(2, 3)
    return torch.stack([digits, sinograms / sinograms.amax()], 1).flatten(0, 1)


def materials() -> Tensor:
    """Four materials, each under a lamp and under coloured lamps."""
    maps = torch.cat([up.data.wood(1, CELL, seed=3), up.data.wood(1, CELL, seed=1)])
    maps = torch.cat([maps, up.data.metal(1, CELL, seed=2), up.data.plastic(1, CELL, seed=1)])
    light = {"view": torch.zeros(4), "light": torch.full((4,), 0.5), "light_azimuth": torch.full((4,), math.pi)}
    lit = [up.Rendering(lighting, Reflection("albedo"))(maps, **light) for lighting in ("directional", "coloured")]
    return torch.stack(lit, 1).flatten(0, 1)


def draw() -> Image.Image:
    rows = [picture_sheet(row, columns=COLUMNS, cell=CELL) for row in (*shapes(), lines(), materials())]
    figure = Image.new("RGB", (rows[0].width, sum(row.height for row in rows)))
    for number, row in enumerate(rows):
        figure.paste(row, (0, number * CELL))
    return figure


if __name__ == "__main__":
    draw().save(OUT, quality=85)
