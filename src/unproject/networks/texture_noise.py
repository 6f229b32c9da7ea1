"""Noise of textures, as a function of the code: equal codes give equal textures, of any size."""

from __future__ import annotations

import torch
from torch import Tensor

from ..ops.low_discrepancy import GOLDEN, scramble, unit

GRAIN = (*[(1, 0.0)] * 4, (1, 1.0), (2, 1.0), (1, 0.25), (2, 0.25))
"""Axis along which each of eight sources of noise is stretched (1: down, 2: across), and the share of the side."""


def white_noise(code: Tensor, size: int, sources: int = 1) -> Tensor:
    """Return white noise (B, sources, size, size) of mean 0 and deviation 1, as a function of the code.

    A hash of the bits of the code's first two numbers, of the size, and of the index of the source's pixel. Indices are
    hashed before they meet the code, so that no two codes have the same noise in another order.
    """
    bits = code.detach()[:, :2].float().view(torch.int32).long()
    key = scramble(scramble(scramble(bits[:, 0]) + bits[:, 1]) + size * GOLDEN)
    pixel = scramble(torch.arange(sources * size * size, device=code.device))
    raw = unit(scramble(pixel + key[:, None]), torch.float32) + 2.0**-25
    return ((raw - 0.5) * 12**0.5).to(code.dtype).view(-1, sources, size, size)


def normal_noise(code: Tensor, size: int, sources: int = 1) -> Tensor:
    """Return white noise (B, sources, size, size), normally distributed, as a function of the code."""
    uniform = white_noise(code, size, sources).double() / 12**0.5 + 0.5
    return torch.special.ndtri(uniform.clamp(1e-6, 1 - 1e-6)).to(code.dtype)


def stretched(white: Tensor, times: int = 1) -> Tensor:
    """Return noise (B, sources, size, size) of white noise, of maps `times` as large as those of training.

    Of each eight sources the first four stay as they are; the others are stretched by `GRAIN`, to grooves and joints
    from edge to edge and to fibres, which convolutions of three pixels cannot make from white noise.
    """
    return torch.stack([_stretched(x, *GRAIN[k % len(GRAIN)], times) for k, x in enumerate(white.unbind(1))], 1)


def _stretched(x: Tensor, axis: int, share: float, times: int) -> Tensor:
    """Average white noise (B, S, S) along an axis over a share of the side of training, at the same deviation."""
    if share == 1:
        return x.narrow(axis, 0, 1).expand_as(x)
    n = max(1, round(share * x.shape[axis] / times))
    return torch.stack([x.roll(k, axis) for k in range(n)]).sum(0) * n**-0.5
