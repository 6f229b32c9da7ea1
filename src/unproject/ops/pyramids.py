"""Gaussian and Laplacian pyramids of images (..., H, W).

With b the binomial filter (1, 4, 6, 4, 1)/16 along both axes, borders reflected:

    g_0 = x,   g_{l+1} = (b * g_l) ↓2,   bands g_l - (4b) * (g_{l+1} ↑2),   last the rest g_L

References:
    Burt and Adelson, The Laplacian pyramid as a compact image code, 1983.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise

import torch
from torch import Tensor
from torch.nn.functional import conv1d, pad

BINOMIAL = (1 / 16, 4 / 16, 6 / 16, 4 / 16, 1 / 16)


def laplacian_pyramid(x: Tensor, smallest: int) -> list[Tensor]:
    """Return the bands of (..., H, W), finest first; the low-pass rest is last, its shorter side `smallest` or more."""
    levels = gaussian_pyramid(x, smallest)
    return [fine - _twice(coarse, *fine.shape[-2:]) for fine, coarse in pairwise(levels)] + [levels[-1]]


def gaussian_pyramid(x: Tensor, smallest: int) -> list[Tensor]:
    """Return x (..., H, W), repeatedly blurred and halved while the shorter side is at least `smallest`."""
    levels = [x]
    while min(side + 1 for side in levels[-1].shape[-2:]) // 2 >= smallest:
        rows, columns = (binomial_filter(side, x)[::2] for side in levels[-1].shape[-2:])
        levels.append(rows @ levels[-1] @ columns.T)
    return levels


def _twice(coarse: Tensor, height: int, width: int) -> Tensor:
    rows, columns = (2 * binomial_filter(side, coarse)[:, ::2] for side in (height, width))
    return rows @ coarse @ columns.T


@lru_cache(maxsize=64)
def filter_matrix(n: int, taps: tuple[float, ...]) -> Tensor:
    """Return the matrix (n, n) that filters n samples with `taps`, reflected at both ends."""
    reach = len(taps) // 2
    steps = pad(torch.eye(n)[:, None], (reach, reach), mode="reflect")
    return conv1d(steps, torch.tensor(taps)[None, None])[:, 0].T.contiguous()


def binomial_filter(n: int, like: Tensor) -> Tensor:
    """Return the matrix (n, n) of the binomial filter, of the type and on the device of a tensor."""
    return _placed(n, like.dtype, like.device)


@lru_cache(maxsize=64)
def _placed(n: int, dtype: torch.dtype, device: torch.device) -> Tensor:
    return filter_matrix(n, BINOMIAL).to(device, dtype)
