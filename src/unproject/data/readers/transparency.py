"""Transparency: whether alpha cuts an object out, or is a rim around a photograph, as editors leave it."""

from __future__ import annotations

import numpy as np

from .borders import border, bounding_box

Margins = tuple[tuple[int, int], tuple[int, int]]
"""Pixels above and below, at the left and at the right."""

NO_MARGINS: Margins = ((0, 0), (0, 0))
OPAQUE = 0.99
"""Share of opaque pixels from which on alpha cuts nothing out."""
WIDE, STRAIGHT = 0.9, 0.95
"""Size of the rectangle that a rim leaves, of the picture's, and the share of it, and of the middle of its sides, that
is opaque; cut-outs of boxes have wider margins, or sides that are not along the picture's."""
PLAIN = 0.08
"""How far from the border's colour something has to be inside a rim, if it is one."""


def opaque_part(picture: np.ndarray) -> tuple[np.ndarray, Margins]:
    """Return the colours of a picture (H, W, 2 or 4) whose alpha cuts nothing out, without its rim, and the margins.

    What is transparent in the corners gets the colour of the border. Other pictures are returned as they are.
    """
    if picture.shape[-1] not in (2, 4) or picture[..., -1].min() >= 1:
        return picture, NO_MARGINS
    opaque = picture[..., -1] >= 0.5
    if not opaque.any():
        return picture, NO_MARGINS
    (top, left), height, width = bounding_box(opaque)
    inside = opaque[top : top + height, left : left + width]
    colours = picture[top : top + height, left : left + width, :-1].copy()
    backdrop = np.median(border(colours)[border(inside)], axis=0)
    colours[~inside] = backdrop
    shows = np.abs(colours - backdrop).max() >= PLAIN
    if opaque.mean() <= OPAQUE and not (shows and _is_left_by_a_rim(inside, opaque.size)):
        return picture, NO_MARGINS
    rows, columns = opaque.shape
    return colours, ((top, rows - top - height), (left, columns - left - width))


def _is_left_by_a_rim(inside: np.ndarray, pixels: int) -> bool:
    """Whether a mask in its bounding box is nearly as large as a picture of so many pixels, and a rectangle."""
    height, width = inside.shape
    rows, columns = slice(height // 4, height - height // 4), slice(width // 4, width - width // 4)
    sides = inside[0, columns], inside[-1, columns], inside[rows, 0], inside[rows, -1], inside
    return inside.size >= WIDE * pixels and min(side.mean() for side in sides) >= STRAIGHT
