"""Thin parts of silhouettes: the level above which coarse pictures still show them, and how they show them at ½."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import max_pool2d

from .framing import FAINT
from .parts import grown, number_parts

LEVELS = (0.5, 0.45, 0.4, 0.35, 0.3, 0.25)
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


def with_thin_parts(silhouettes: Tensor, level: float) -> Tensor:
    """Return silhouettes (N, 1, H, W) whose thin parts have their level at one half, y ↦ y^(log ½ / log level).

    Thick is what squares of 3×3 pixels cover that are all at least ½ (the morphological opening), and thin what is at
    least `level` and no neighbour of it. Thin parts and the eight neighbours of each pixel of them are raised; 0 and 1
    stay. All else stays as it is: with the rims of thick parts raised too, objects would be learned too large.

    Examples:
        >>> import torch, unproject as up
        >>> hammer = torch.zeros(1, 1, 6, 9)
        >>> hammer[..., 1:4, 1:4], hammer[..., 2, 4:8], hammer[..., 4, 1:4] = 1, 0.25, 0.25  # head, handle, rim
        >>> up.ops.with_thin_parts(hammer, 0.25)[0, 0, 2]
        tensor([0.0000, 1.0000, 1.0000, 1.0000, 0.5000, 0.5000, 0.5000, 0.5000, 0.0000])
        >>> up.ops.with_thin_parts(hammer, 0.25)[0, 0, 4]
        tensor([0.0000, 0.2500, 0.2500, 0.2500, 0.0000, 0.0000, 0.0000, 0.0000, 0.0000])
    """
    if level == 0.5:
        return silhouettes
    thick = _widened(~_widened(silhouettes < 0.5))
    thin = (silhouettes >= level - ROUNDING) & ~_widened(thick)
    raised = silhouettes.clamp(0, 1) ** (math.log(0.5) / math.log(level))
    return torch.where(_widened(thin), raised, silhouettes)


def _widened(mask: Tensor) -> Tensor:
    """Add the eight neighbours of each pixel; what is outside of the picture adds none."""
    return max_pool2d(mask.float(), 3, stride=1, padding=1) > 0.5
