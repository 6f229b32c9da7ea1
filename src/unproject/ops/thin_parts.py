"""Thin parts of silhouettes: the level above which coarse pictures still show them."""

from __future__ import annotations

import math

import numpy as np
from torch import Tensor

from .parts import grown, number_parts

LEVELS = (0.5, 0.45, 0.4, 0.35, 0.3, 0.25)
FAINT = 0.1
"""The share of a pixel that is covered from which something is there to be shown."""
SHARE = 0.95
ROUNDING = 1e-6
"""By so much a share that was computed may be below the true one."""


def level_of_thin_parts(silhouettes: Tensor) -> float:
    """Return the largest level of 0.5, 0.45, ..., 0.25 at which silhouettes (N, 1, H, W) show their thin parts.

    Pixels hold the share of their area that is covered. A leg half a pixel wide covers half of a pixel, or a quarter of
    two: what exceeds 0.5 has no leg, or pieces of one. At a level t a picture shows its parts if what is at least t is
    in as few parts as what is at least 0.1, and comes within a pixel of all of it. So many pictures are to show them
    (95 %); if fewer do at each level, 0.25 is returned.

    Examples:
        >>> import torch, unproject as up
        >>> stool = torch.zeros(1, 1, 8, 8)
        >>> stool[..., 1:4, 1:7] = 1
        >>> stool[..., 4:7, 2], stool[..., 4:7, 5] = 0.4, 0.8
        >>> up.ops.level_of_thin_parts(stool)
        0.4
    """
    pictures = (silhouettes + ROUNDING).cpu().numpy()
    for level in LEVELS:
        if sum(_shows(picture, level) for picture in pictures) >= SHARE * len(pictures):
            return level
    return LEVELS[-1]


def _shows(picture: np.ndarray, level: float) -> bool:
    shown, there = picture >= level, picture >= FAINT
    return _count(shown) <= _count(there) and not (there & ~grown(shown)).any()


def _count(mask: np.ndarray) -> int:
    return len(number_parts(mask)[1]) - 1


def with_level_at_half(silhouettes: Tensor, level: float) -> Tensor:
    """Return y^(log ½ / log level): `level` becomes ½, 0 and 1 stay.

    Examples:
        >>> import torch, unproject as up
        >>> up.ops.with_level_at_half(torch.tensor([0.0, 0.25, 1.0]), 0.25)
        tensor([0.0000, 0.5000, 1.0000])
    """
    return silhouettes if level == 0.5 else silhouettes.clamp(0, 1) ** (math.log(0.5) / math.log(level))
