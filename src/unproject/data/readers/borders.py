"""Borders and bounding boxes of pictures (H, W, ...)."""

from __future__ import annotations

import numpy as np


def border(picture: np.ndarray) -> np.ndarray:
    """Return the outermost pixels (P, ...) of a picture (H, W, ...)."""
    return np.concatenate((picture[0], picture[-1], picture[:, 0], picture[:, -1]))


def border_colour(picture: np.ndarray) -> np.ndarray:
    """Return the median colour (C,) of a picture's outermost pixels."""
    return np.median(border(picture), axis=0)


def bounding_box(mask: np.ndarray) -> tuple[tuple[int, int], int, int]:
    """Return the upper left corner, the height and the width of what a mask (H, W) holds, which is something."""
    rows, columns = np.flatnonzero(mask.any(1)), np.flatnonzero(mask.any(0))
    return (rows[0], columns[0]), int(rows[-1] - rows[0] + 1), int(columns[-1] - columns[0] + 1)
