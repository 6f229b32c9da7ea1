"""What a ray sees of the occupancies p_1 … p_n along it, from the nearest sample to the farthest.

========== =============================== ==========================================
rule       formula                         source
========== =============================== ==========================================
any        1 - Π (1 - p_k)                 released MP-GAN code ("drc"), after DRC
alpha      Σ p_k [p_1 + … + p_k <= 1]      released MP-GAN code ("nv")
absorption 1 - exp(-density Σ p_k)         PrGAN (Gadelha et al. 2017), Beer-Lambert
========== =============================== ==========================================

"alpha" keeps a sample only if the running sum *with* it is at most 1: a wall met as 0.3, 1, 1 counts 0.3,
so solid objects have grey rims. It jumps where a running sum passes 1. The other two are smooth.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from .resampling import centres

_TRANSPARENCY = 1e-6
_ROUNDING = 1e-4


def any_occupied(p: Tensor, dim: int = -1) -> Tensor:
    """1 - Π (1 - p): the chance that at least one sample is occupied.

    A sample lets at least 1e-6 of the light through; so the gradient Π_{j≠k} (1 - p_j) is found
    by a division, right and finite also where p = 1.
    """
    return 1 - _TransmittedLight.apply(p, dim)


def capped_sum(p: Tensor, dim: int = -1) -> Tensor:
    """Σ p_k [p_1 + … + p_k <= 1]: occupancies summed front to back while the running sum is at most 1."""
    return torch.where(p.detach().cumsum(dim) <= 1 + _ROUNDING, p, 0).sum(dim)


def absorption(p: Tensor, dim: int = -1, density: float | Tensor = 1.0) -> Tensor:
    """1 - exp(-density Σ p): the light that a fog of this density a sample takes away.

    A tensor of densities must broadcast with the sum.
    """
    return -torch.expm1(-density * p.sum(dim))


def expected_depth(x: Tensor) -> Tensor:
    """Where a ray is expected to stop: Σ_k w_k p_k Π_{j nearer} (1 - p_j), w = 1 nearest, and -1 if nothing stops it.

    Args:
        x: (B, X, Y, Z) volume in the camera's frame (`ops.rotate`).

    Returns:
        (B, 1, Y, X) picture of w in [-1, 1]: larger is nearer, the background is -1.
    """
    p = x.flip(3)
    passed = (1 - p).cumprod(3)
    reached = torch.cat((torch.ones_like(p[..., :1]), passed[..., :-1]), 3)
    depth = (-centres(p.shape[3], p) * p * reached).sum(3) - passed[..., -1]
    return depth.transpose(1, 2).flip(1).unsqueeze(1)


class _TransmittedLight(torch.autograd.Function):
    """Π (1 - (1 - ε) p), in as few passes over memory as can be: they are most of the cost of a silhouette."""

    @staticmethod
    def forward(ctx: Any, p: Tensor, dim: int) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        q = torch.add(p.new_ones(()), p, alpha=_TRANSPARENCY - 1)
        product = q.prod(dim)
        ctx.save_for_backward(q, product)
        ctx.dim = dim
        return product

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:  # pyright: ignore[reportIncompatibleMethodOverride]
        q, product = ctx.saved_tensors
        return (gradient * product * (_TRANSPARENCY - 1)).unsqueeze(ctx.dim) / q, None
