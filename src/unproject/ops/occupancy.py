"""Occupancy rules: the value of a pixel from the occupancies p_1 … p_n along its ray, nearest first.

========== =============================== ==========================================
rule       formula                         source
========== =============================== ==========================================
any        1 - Π (1 - p_k)                 released MP-GAN code ("drc"), after DRC
alpha      Σ p_k [p_1 + … + p_k <= 1]      released MP-GAN code ("nv")
absorption 1 - exp(-density Σ p_k)         PrGAN (Gadelha et al. 2017), Beer-Lambert
========== =============================== ==========================================

"alpha" keeps a sample only if the running sum *with* it is at most 1: samples 0.3, 1, 1 of a wall give 0.3, so solid
objects have grey rims. It is discontinuous where a running sum passes 1. The other two are smooth.
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
    """Compute 1 - Π (1 - p), the probability that at least one sample is occupied.

    Each factor is at least 1e-6, so that the gradient Π_{j≠k} (1 - p_j), computed by a division, is finite and correct
    where p = 1.

    Examples:
        >>> import torch, unproject as up
        >>> up.ops.any_occupied(torch.tensor([0.5, 0.5]))
        tensor(0.7500)
    """
    return 1 - _TransmittedLight.apply(p, dim)


def capped_sum(p: Tensor, dim: int = -1) -> Tensor:
    """Compute Σ p_k [p_1 + … + p_k <= 1], the sum from front to back while the running sum is at most 1.

    Examples:
        >>> import torch, unproject as up
        >>> up.ops.capped_sum(torch.tensor([0.3, 1.0, 1.0]))
        tensor(0.3000)
    """
    return torch.where(p.detach().cumsum(dim) > 1 + _ROUNDING, 0, p).sum(dim)  # NaN stays NaN


def absorption(p: Tensor, dim: int = -1, density: float | Tensor = 1.0) -> Tensor:
    """Compute 1 - exp(-density Σ p), the light absorbed by a medium of this density (Beer-Lambert).

    A tensor of densities must broadcast with the sum.

    Examples:
        >>> import torch, unproject as up
        >>> up.ops.absorption(torch.ones(3), density=0.5)
        tensor(0.7769)
    """
    return -torch.expm1(-density * p.sum(dim))


def expected_depth(x: Tensor) -> Tensor:
    """Compute the expected depth at which a ray stops: Σ_k w_k p_k Π_{j nearer} (1 - p_j), w = -1 for the background.

    Args:
        x: (B, X, Y, Z) volume in the camera's frame (`ops.rotate`).

    Returns:
        (B, 1, Y, X) image of w in [-1, 1]: larger is nearer, the background is -1.

    Examples:
        >>> import torch, unproject as up
        >>> volume = torch.zeros(1, 4, 4, 4)
        >>> volume[0, 0, 0, 3] = 1  # at the lower left, nearest to the camera
        >>> up.ops.expected_depth(volume)[0, 0]
        tensor([[-1.0000, -1.0000, -1.0000, -1.0000],
                [-1.0000, -1.0000, -1.0000, -1.0000],
                [-1.0000, -1.0000, -1.0000, -1.0000],
                [ 0.7500, -1.0000, -1.0000, -1.0000]])
    """
    p = x.flip(3)
    passed = (1 - p).cumprod(3)
    reached = torch.cat((torch.ones_like(p[..., :1]), passed[..., :-1]), 3)
    depth = (-centres(p.shape[3], p) * p * reached).sum(3) - passed[..., -1]
    return depth.transpose(1, 2).flip(1).unsqueeze(1)


class _TransmittedLight(torch.autograd.Function):
    """Π (1 - (1 - ε) p), in few passes over memory, which are most of the cost of a silhouette."""

    @staticmethod
    def forward(ctx: Any, p: Tensor, dim: int) -> Tensor:
        q = torch.add(p.new_ones(()), p, alpha=_TRANSPARENCY - 1)
        product = q.prod(dim)
        ctx.save_for_backward(q, product)
        ctx.dim = dim
        return product

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        q, product = ctx.saved_tensors
        return (gradient * product * (_TRANSPARENCY - 1)).unsqueeze(ctx.dim) / q, None
