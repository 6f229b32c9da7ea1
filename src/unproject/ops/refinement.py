"""Refinement: values on a grid several times as fine, whose averages over each old cell are the old values.

Values x_i are taken for averages over unit cells. Within cell i the parabola with that average, whose values at the two
edges are (x_{i-1} + x_i) / 2 and (x_i + x_{i+1}) / 2, is averaged over t parts; beyond the ends x is constant. With ξ
from 0 to 1 across the cell the integral from its left edge is

    V(ξ) = x_{i-1} (ξ - 2 ξ² + ξ³) / 2 + x_i (ξ + 3 ξ² - 2 ξ³) / 2 + x_{i+1} (ξ³ - ξ²) / 2

so part k is t (V((k + 1) / t) - V(k / t)); for t = 2 the parts are x_i ∓ (x_{i+1} - x_{i-1}) / 8. V(1) = x_i: averages
are kept exactly. Linear functions are reproduced, and for t = 2 quadratics.

References:
    Colella & Woodward 1984, The piecewise parabolic method; V is Catmull & Rom's spline through the sums of x.
"""

from __future__ import annotations

import torch
from torch import Tensor


def refined(x: Tensor, times: int, axis: int) -> Tensor:
    """Return x with `axis` `times` as long; averages over `times` neighbours are the values of x.

    Examples:
        >>> import torch, unproject as up
        >>> up.ops.refined(torch.tensor([0.0, 0.0, 8.0, 8.0]), 2, axis=0)
        tensor([ 0.,  0., -1.,  1.,  7.,  9.,  8.,  8.])
    """
    if times == 1:
        return x
    count = x.shape[axis]
    place = torch.arange(count, device=x.device)
    before = x.index_select(axis, (place - 1).clamp(min=0))
    after = x.index_select(axis, (place + 1).clamp(max=count - 1))
    parts = [a * before + b * x + c * after for a, b, c in part_weights(times)]
    axis = axis % x.dim()
    return torch.stack(parts, axis + 1).flatten(axis, axis + 1)


def part_weights(times: int) -> list[tuple[float, float, float]]:
    """Return the weights of (x_{i-1}, x_i, x_{i+1}) in each part of cell i."""
    edges = [_integral(k / times) for k in range(times + 1)]
    parts = zip(edges, edges[1:], strict=False)
    return [(times * (high[0] - low[0]), times * (high[1] - low[1]), times * (high[2] - low[2])) for low, high in parts]


def _integral(t: float) -> tuple[float, float, float]:
    """Return the weights of V(ξ)."""
    return (t - 2 * t**2 + t**3) / 2, (t + 3 * t**2 - 2 * t**3) / 2, (t**3 - t**2) / 2
