"""How wide silhouettes are locally."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor


def local_widths(silhouettes: Tensor) -> Tensor:
    """Return the width (N, H, W) of silhouettes (N, H, W) at each pixel: (2 Σ_k ε^k(m) - 1)₊, 0 ≤ k < size / 4.

    ε is the erosion by a square of 3×3 pixels, nothing beyond the picture. Of a mask it is 2 d - 1, d the chessboard
    distance to the outside: the side of the largest square centred at the pixel that fits in, up to half the picture's
    shorter side, size.

    Examples:
        >>> import torch, unproject as up
        >>> bar = torch.zeros(1, 8, 16)
        >>> bar[:, 2:5] = 1
        >>> up.ops.local_widths(bar)[0, :, 8]
        tensor([0., 0., 1., 3., 1., 0., 0., 0.])
    """
    eroded = F.pad(silhouettes, (1, 1, 1, 1))[:, None]
    found = torch.zeros_like(eroded)
    for _ in range(min(silhouettes.shape[-2:]) // 4):
        found += eroded
        eroded = -F.max_pool2d(-eroded, 3, stride=1, padding=1)
    return (2 * found - 1).clamp_min(0)[:, 0, 1:-1, 1:-1]
