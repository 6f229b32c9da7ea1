"""Noise of textures, as a function of the code: equal codes give equal textures, of any size."""

from __future__ import annotations

import torch
from torch import Tensor

GRAIN = (*[(1, 0.0)] * 4, (1, 1.0), (2, 1.0), (1, 0.25), (2, 0.25))
"""Axis along which each of eight sources of noise is stretched (1: down, 2: across), and the share of the side."""


def white_noise(code: Tensor, size: int, sources: int = 1) -> Tensor:
    """Return white noise (B, sources, size, size) of mean 0 and deviation 1, as a function of the code.

    frac(sin) of the pixel's index and the code, as in shaders. Larger noise of the same code begins with the numbers of
    smaller noise.
    """
    seed = code.detach().double()[:, :2].sum(1) * 1e3
    pixel = torch.arange(sources * size * size, dtype=torch.float64, device=code.device)
    raw = torch.frac(torch.sin((pixel + 1) * 12.9898 + seed[:, None] * 78.233).abs() * 43758.5453)
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
