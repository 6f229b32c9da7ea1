"""1797 real handwritten digits, 8² pixels: the images that the digits recipes learn when none are named.

The test part of Optical Recognition of Handwritten Digits, E. Alpaydin and C. Kaynak 1998, UCI Machine Learning
Repository, CC BY 4.0; the copy that scikit-learn distributes.
"""

from __future__ import annotations

from importlib.resources import as_file, files

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from .._types import UserError

MIN_SIDE = 4
"""Pixels a side, of which the digits have three quarters."""

HELD_OUT = 297


def digits(size: int = 32, held_out: bool = False) -> Tensor:
    """(1500, 1, size, size) in [0, 1], white on black; or the 297 others that nothing is to be trained on.

    The 8² pixels become (3/4 size)² smoothly, with a margin of an eighth of the side all around, as MNIST has.
    """
    if size < MIN_SIDE:
        raise UserError(f"digits: size={size}: give at least {MIN_SIDE} pixels a side")
    images = _stored("images", held_out).float()[:, None] / 16
    inner = size * 3 // 4
    images = F.interpolate(images, size=(inner, inner), mode="bicubic", align_corners=False).clamp(0, 1)
    before = (size - inner) // 2
    after = size - inner - before
    return F.pad(images, (before, after, before, after))


def digit_labels(held_out: bool = False) -> Tensor:
    """Which digit each of `digits(held_out=...)` is, (N,) integers 0 to 9: for scores, never for training."""
    return _stored("labels", held_out).long()


def _stored(name: str, held_out: bool) -> Tensor:
    with as_file(files("unproject.data") / "digits8.npz") as path:
        stored = np.load(path, allow_pickle=False)[name]
    return torch.from_numpy(stored[-HELD_OUT:] if held_out else stored[:-HELD_OUT])
