"""Gradients of shading by central differences, as in section 2.4 of the paper's supplemental.

The estimate's sample points are fixed, so both sides of a difference have the same ones. Gradients by the albedos are
analytic. Those by the roughness and by the normal's spherical angles θ, φ are central differences of `DELTA`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.autograd.function import once_differentiable

from .lengths import length
from .microfacet import LEAST_ROUGHNESS

DELTA = 1e-3
EPSILON = 1e-12

Estimate = Callable[[Tensor], Tensor]
"""Maps (B, 8, H, W) to radiance (B, 3, H, W)."""


class CentralDifferences(torch.autograd.Function):
    """y = estimate(maps), differentiated by the albedos analytically and by the other maps by differences."""

    @staticmethod
    def forward(ctx: Any, maps: Tensor, estimate: Estimate) -> Tensor:
        ctx.save_for_backward(maps)
        ctx.estimate = estimate
        return estimate(maps)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None]:
        (maps,), estimate = ctx.saved_tensors, ctx.estimate

        def along(up: Tensor, down: Tensor) -> Tensor:
            return ((estimate(up) - estimate(down)) * gradient).sum(1, keepdim=True)

        with torch.enable_grad():
            x = maps.detach().requires_grad_()
            (analytic,) = torch.autograd.grad(estimate(x), x, gradient)
        result = torch.zeros_like(maps)
        result[:, :4] = analytic[:, :4]
        result[:, 4:5] = _by_roughness(maps, along)
        result[:, 5:] = _by_normal(maps, along)
        return result, None


def _by_roughness(maps: Tensor, along: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    above, below = maps.clone(), maps.clone()
    above[:, 4:5] = above[:, 4:5].clamp(min=LEAST_ROUGHNESS) + DELTA
    below[:, 4:5] = (below[:, 4:5] - DELTA).clamp(min=LEAST_ROUGHNESS)
    derivative = along(above, below) / (above[:, 4:5] - below[:, 4:5])
    return torch.where(maps[:, 4:5] >= LEAST_ROUGHNESS, derivative, 0)


def _by_normal(maps: Tensor, along: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
    result = torch.zeros_like(maps[:, 5:])
    far = length(maps[:, 5:], 1)
    normal = maps[:, 5:] / far
    theta, phi = normal[:, 2:].clamp(-1, 1).acos(), torch.atan2(normal[:, 1:2], normal[:, :1])
    for d_theta, d_phi in ((DELTA, 0.0), (0.0, DELTA)):
        above, below = maps.clone(), maps.clone()
        above[:, 5:], below[:, 5:] = (_spherical(theta + k * d_theta, phi + k * d_phi) for k in (1, -1))
        step = above[:, 5:] - below[:, 5:]
        # The difference along the step, in the direction of the step; 0 / 0 at the pole is 0.
        result += along(above, below) * step / step.square().sum(1, keepdim=True).clamp(min=EPSILON)
    return result / far  # shading is of n / |n|


def _spherical(theta: Tensor, phi: Tensor) -> Tensor:
    return torch.cat([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()], 1)
