"""Pictures of confusion matrices."""

from __future__ import annotations

from PIL import Image, ImageDraw, ImageFont
from torch import Tensor

from .._types import UserError

CELL, MARGIN = 30, 64


def confusion_picture(confusion: Tensor) -> Image.Image:
    """Draw a confusion matrix (K, K): rows are the true bin, columns the predicted one, darker is more.

    Each row is shown as percentages of its sum (rows without images stay white).

    Raises:
        UserError: for another shape.

    Examples:
        >>> import torch
        >>> confusion_picture(torch.eye(4)).size
        (200, 200)
    """
    if confusion.ndim != 2 or confusion.shape[0] != confusion.shape[1] or confusion.numel() == 0:
        raise UserError(f"confusion_picture: give a matrix (K, K), not {tuple(confusion.shape)}")
    bins = len(confusion)
    share = (confusion.double() / confusion.sum(1, keepdim=True).clamp_min(1)).tolist()
    side = MARGIN + CELL * bins + 16
    picture = Image.new("RGB", (side, side), "white")
    draw = ImageDraw.Draw(picture)
    for row in range(bins):
        for column in range(bins):
            _draw_cell(draw, row, column, share[row][column])
    _draw_axes(picture, bins)
    return picture


def _draw_cell(draw: ImageDraw.ImageDraw, row: int, column: int, share: float) -> None:
    left, top = MARGIN + CELL * column, MARGIN + CELL * row
    fill = (round(255 - 225 * share), round(255 - 175 * share), round(255 - 105 * share))
    draw.rectangle((left, top, left + CELL, top + CELL), fill=fill, outline=(215, 215, 215))
    if share >= 0.005:
        ink = "white" if share > 0.5 else "black"
        _text(draw, left + CELL // 2, top + CELL // 2, f"{100 * share:.0f}", 12, ink)


def _draw_axes(picture: Image.Image, bins: int) -> None:
    draw, middle = ImageDraw.Draw(picture), MARGIN + CELL * bins // 2
    for k in range(bins):
        centre = MARGIN + CELL * k + CELL // 2
        _text(draw, centre, MARGIN - 12, str(k), 13)
        _text(draw, MARGIN - 14, centre, str(k), 13)
    _text(draw, middle, 22, "predicted view bin (best gauge)" if bins > 7 else "predicted", 15)
    label = Image.new("RGB", (CELL * bins, 24), "white")
    _text(ImageDraw.Draw(label), CELL * bins // 2, 12, "true view bin, % of row" if bins > 7 else "true", 15)
    picture.paste(label.rotate(90, expand=True), (8, MARGIN))


def _text(draw: ImageDraw.ImageDraw, x: int, y: int, text: str, size: int, ink: str = "black") -> None:
    draw.text((x, y), text, fill=ink, font=ImageFont.load_default(size), anchor="mm")
