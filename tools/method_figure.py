"""Draw docs/images/method.webp: codes → generator → samples → projections → discriminators ← collections.

python tools/method_figure.py
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont

from unproject.data import chairs
from unproject.export import render_volume
from unproject.projections.silhouette import Silhouette

OUT = Path(__file__).parent.parent / "docs" / "images" / "method.webp"
WIDTH, HEIGHT, CELL = 1500, 560, 112
INK, GREY, BLUE, GREEN = (40, 44, 52), (120, 126, 136), (66, 106, 179), (70, 140, 90)
ANGLES = (0, 45, 90)


def font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size=size)


def box(
    draw: ImageDraw.ImageDraw, place: tuple[int, ...], title: str, lines: tuple[str, ...], colour: tuple[int, ...]
) -> None:
    """Draw a titled box at (left, top, width, height)."""
    x, y, w, h = place
    draw.rounded_rectangle((x, y, x + w, y + h), 14, outline=colour, width=3, fill=(250, 251, 253))
    draw.text((x + w / 2, y + 26), title, colour, font(24), anchor="mm")
    for k, line in enumerate(lines):
        draw.text((x + w / 2, y + 56 + 24 * k), line, INK, font(18), anchor="mm")


def arrow(draw: ImageDraw.ImageDraw, x: int, y: int, to_x: int, to_y: int, colour: tuple = GREY) -> None:
    draw.line((x, y, to_x, to_y), colour, 3)
    angle = math.atan2(to_y - y, to_x - x)
    for side in (2.6, -2.6):
        draw.line((to_x, to_y, to_x + 14 * math.cos(angle + side), to_y + 14 * math.sin(angle + side)), colour, 3)


def silhouette(volume: torch.Tensor, degrees: float) -> Image.Image:
    """A silhouette, dark on white, with a frame."""
    angle = torch.tensor([math.radians(degrees)])
    seen = Silhouette(size=64)(volume[None], azimuth=angle, elevation=torch.zeros(1))[0, 0]
    picture = Image.fromarray((255 - 200 * seen.clamp(0, 1)).byte().numpy()).convert("RGB")
    picture = picture.resize((CELL, CELL), Image.Resampling.LANCZOS)
    ImageDraw.Draw(picture).rectangle((0, 0, CELL - 1, CELL - 1), outline=GREY)
    return picture


def main() -> None:
    sheet = Image.new("RGB", (WIDTH, HEIGHT), "white")
    draw = ImageDraw.Draw(sheet)
    *real, made = chairs(4, 64, seed=11)
    box(draw, (20, 225, 170, 110), "generator", ("z ~ N(0, 1)", "x = G(z)"), BLUE)
    solid = np.asarray(render_volume(made.numpy(), math.radians(30), size=210))
    sheet.paste(Image.fromarray(solid), (230, 175))
    draw.text((335, 400), "a sample: never observed", INK, font(18), anchor="mm")
    arrow(draw, 195, 280, 232, 280)
    for k, degrees in enumerate(ANGLES):
        y = 40 + 165 * k
        middle = y + CELL // 2
        arrow(draw, 450, 280, 500, middle)
        box(draw, (510, y + 8, 190, 96), f"projection P{k + 1}", (f"azimuth {degrees}°",), BLUE)
        sheet.paste(silhouette(made, degrees), (745, y))
        arrow(draw, 704, middle, 740, middle)
        arrow(draw, 862, middle, 905, middle)
        box(draw, (912, y + 8, 200, 96), f"head D{k + 1}", ("real or projected?",), GREEN)
        arrow(draw, 1165, middle, 1118, middle)
        for n, other in enumerate((real[k], real[(k + 1) % 3])):
            sheet.paste(silhouette(other, degrees + 8 * n), (1170 + (CELL + 8) * n, y))
        draw.text((1418, middle), f"data {k + 1}", INK, font(18), anchor="lm")
    caption = (
        "one discriminator with a head for each observation; the data show other objects; their views may be unknown, "
        "and are then predicted"
    )
    draw.text((750, 535), caption, GREY, font(18), anchor="mm")
    OUT.parent.mkdir(parents=True, exist_ok=True)
    sheet.save(OUT, quality=88)
    print(f"{OUT}: {OUT.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
