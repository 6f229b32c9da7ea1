"""Feet of silhouettes: whether objects stand on a disc, as bodies of revolution do."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from torch import Tensor

from .outlines import upper_outline

ROUND = 0.5
"""The share of round feet from which on objects count as round. It is 0.85 or more of mugs and lamps seen from 14
degrees above, 0.05 or less of drawers, beds, chairs, tables, cars and birds, from there or from level (64 pixels)."""
DEPTH, NARROW = 0.15, 0.2
"""How far above its lowest place a foot reaches, of the object's height; and its least width, of the longer side."""
FLAT, MISFIT = 1.5, 0.35
"""The rise of a flat foot at most, pixels, and the deviation from an ellipse at most, of that from a level line."""
WALL = 0.05
"""Beyond a foot's ends the outline rises by half as much again as a foot does within so much of the object's height."""
BENDS, TOLERANCE = (0.3, 0.4, 0.5, 0.6, 0.7, 0.8), 1.2
"""Where the ends of flat feet with rounded edges begin to bend, and how much worse than those a round one may fit."""


def round_feet(silhouettes: Tensor) -> float:
    """Return the share of silhouettes (N, 1, H, W) that show a round foot: the half of an ellipse.

    A camera at elevation e sees the rim of a disc that stands on the ground as an ellipse, sin(e) times as high as
    wide, of a box a corner, and of legs several. The foot is the lower outline around its lowest place as far as it is
    within 0.15 of the object's height. It is round if it fits b (1 - √(1 - u²)), u from -1 to 1 along it, b > 0, with
    less than 0.35 of its standard deviation left, or half a pixel; better than a corner at any place does; hardly
    worse than a level line with rounded ends, as of boxes with rounded edges from level; and if the outline beyond goes
    up steeply, as the wall of a cylinder does and a belly does not. Feet that rise by less than 1.5 pixels, and those
    narrower than 0.2 of the object, tell nothing.

    Args:
        silhouettes: values from 0 to 1; a column is covered from where it exceeds 0.5.

    Examples:
        >>> import torch, unproject as up
        >>> row, column = torch.meshgrid(torch.arange(32) - 15.5, torch.arange(32) - 15.5, indexing="ij")
        >>> rim = 5 * (1 - (column / 8).square()).clamp_min(0).sqrt() + 6
        >>> corner = 11 - (column - 3).abs()
        >>> inside = column.abs() < 8
        >>> cup, box = ((inside & (row > -10) & (row < low)).float()[None, None] for low in (rim, corner))
        >>> up.ops.round_feet(cup), up.ops.round_feet(box)
        (1.0, 0.0)
    """
    silhouettes = silhouettes.detach().float()
    lower, covered = (part.cpu().numpy() for part in upper_outline(silhouettes[:, 0].flip(1)))
    pictures = (silhouettes[:, 0] > 0.5).cpu().numpy()
    seen = [_has_round_foot(*some) for some in zip(pictures, lower, covered, strict=True) if some[0].any()]
    return float(np.mean(seen)) if seen else 0.0


def _has_round_foot(picture: np.ndarray, lower: np.ndarray, covered: np.ndarray) -> bool:
    rows, columns = np.nonzero(picture.any(1))[0], np.nonzero(covered)[0]
    box = picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    tall = len(box)
    rise = np.where(covered, lower - lower[covered].min(), np.inf)[columns[0] : columns[-1] + 1]
    start, end = _span(rise <= DEPTH * tall, np.nonzero(rise == rise.min())[0])
    foot = rise[start:end]
    if len(foot) < NARROW * max(box.shape) or foot.max() < FLAT or not _is_half_ellipse(foot):
        return False
    return _ends_at_walls(rise, start, end, tall)


def _span(near: np.ndarray, lowest: np.ndarray) -> tuple[int, int]:
    """Return where the run of `near` around the middle of the lowest places starts, and the place after its end."""
    middle = int(lowest[len(lowest) // 2])
    before, after = np.nonzero(~near[:middle])[0], np.nonzero(~near[middle:])[0]
    return int(before[-1]) + 1 if len(before) else 0, middle + int(after[0]) if len(after) else len(near)


def _is_half_ellipse(foot: np.ndarray) -> bool:
    """Whether it fits an ellipse, better than any corner does, and about as well as flat feet with rounded ends."""
    if len(foot) < 3:
        return False
    ellipse, corners, rounded = _bases(len(foot))
    left, bend = _left(foot, ellipse), (ellipse[0, :, 1] * foot).sum()
    fits = (
        left < max(MISFIT * foot.std(), 0.5) and left < _left(foot, corners) and left < TOLERANCE * _left(foot, rounded)
    )
    return bool(bend > 0 and fits)


def _left(foot: np.ndarray, bases: np.ndarray) -> float:
    """Return the least deviation that fits by orthonormal bases (K, N, M) leave."""
    fitted = (bases @ (bases.transpose(0, 2, 1) @ foot[:, None]))[..., 0]
    return float(np.sqrt(np.square(foot - fitted).mean(1)).min())


@lru_cache(maxsize=512)
def _bases(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return orthonormal bases (K, count, M) of half an ellipse, of corners anywhere, and of rounded ends."""
    along = (2 * np.arange(count) + 1) / count - 1
    level = np.ones(count)
    bent = [np.maximum(np.abs(along) - start, 0) / (1 - start) for start in (0.0, *BENDS) if start < along[-1]]
    ellipse, *rounded = (_orthonormal(level, 1 - np.sqrt(1 - part**2)) for part in bent)
    corners = [_orthonormal(level, along, np.maximum(along - place, 0)) for place in along[1:-1]]
    return ellipse[None], np.stack(corners), np.stack(rounded)


def _orthonormal(*basis: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (N, M), each vector on the side of the one that it is made of."""
    q, r = np.linalg.qr(np.stack(basis, 1))
    return q * np.sign(np.diag(r))


def _ends_at_walls(rise: np.ndarray, start: int, end: int, tall: int) -> bool:
    reach = max(1, round(WALL * tall))
    around = np.pad(rise, reach, constant_values=np.inf)
    beside = around[start : start + reach].max(), around[end + reach : end + 2 * reach].max()
    return min(beside) >= 1.5 * DEPTH * tall
