"""Lengths of vectors whose components are planes, such as normals (B, 3, H, W).

`torch.linalg.vector_norm` and `F.normalize` take ten to seventy times as long on a CPU where the components are not the
last axis. The values are the same but for rounding.
"""

from __future__ import annotations

from torch import Tensor

LEAST = 1e-12
"""The least length: a vector of zeros is divided by this and stays one, as with `F.normalize`."""


def length(x: Tensor, dim: int) -> Tensor:
    """Return |x| = √(Σ x²) over an axis, which stays as one of size 1; at least 1e-12, and without a gradient below."""
    return x.square().sum(dim, keepdim=True).clamp_min(LEAST**2).sqrt()


def unit(x: Tensor, dim: int) -> Tensor:
    """Return x / |x| over an axis, as `F.normalize` does."""
    return x / length(x, dim)
