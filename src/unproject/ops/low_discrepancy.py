"""Sample points as a function of (seed, pixel, sample), without a table of pixels × samples.

The points of a pixel are Roberts' additive recurrence s (1/g, 1/g²) mod 1, g³ = g + 1, shifted by an offset that is a
hash of the pixel and of a seed; "independent" points are hashes of seed, pixel and sample. The hash has 32 bits and two
multiplications (constants of Wellons' search); `shading.cpp` computes the same.

References:
    Roberts 2018, The unreasonable effectiveness of quasirandom sequences. Cranley and Patterson 1976 (the shift).
"""

from __future__ import annotations

import torch
from torch import Tensor

STEPS = (0.7548776662466927, 0.5698402909980532)
MASK = 0xFFFFFFFF
GOLDEN = 0x9E3779B9


def scramble(x: Tensor) -> Tensor:
    """Hash 32-bit numbers held in int64."""
    x = x & MASK
    x = ((x ^ (x >> 16)) * 0x7FEB352D) & MASK
    x = ((x ^ (x >> 15)) * 0x846CA68B) & MASK
    return x ^ (x >> 16)


def unit(x: Tensor, dtype: torch.dtype) -> Tensor:
    """Return the upper 24 bits as a number in [0, 1)."""
    return (x >> 8).to(dtype) * 2.0**-24


def seeds(jitter: Tensor) -> Tensor:
    """Return hashes (B,) of numbers in [0, 1)."""
    return scramble((jitter.detach().double() * 2**24).floor().long())


def offsets(seed: Tensor, pixels: int, dimension: int) -> Tensor:
    """Return hashes (B, pixels) for one dimension of the points, of seeds (B,)."""
    pixel = torch.arange(pixels, device=seed.device)
    return scramble((pixel * 4 + dimension) ^ seed[:, None])


def points(offset: Tensor, sample: Tensor, dimension: int, dtype: torch.dtype, independent: bool = False) -> Tensor:
    """Return coordinate `dimension` (0 or 1) of the points `sample` (int64): (B, pixels, samples)."""
    if independent:
        return unit(scramble(offset[..., None] + sample * GOLDEN), dtype)
    along = torch.frac(sample.double() * STEPS[dimension]).to(dtype)
    return torch.frac(unit(offset, dtype)[..., None] + along)
