"""Limits of logits: neither saturated, where a sigmoid has no gradient, nor growing without end."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor


def limited(t: Tensor, limit: float | Tensor) -> Tensor:
    """Return t / √(1 + (t / limit)²), within ±limit; its derivative falls with |t|⁻³, not exponentially.

    Examples:
        >>> import torch, unproject as up
        >>> up.ops.limited(torch.tensor([0.5, 10.0, -1e6]), 10.0)
        tensor([  0.4994,   7.0711, -10.0000])
    """
    return t * torch.rsqrt(1 + (t / limit).square())


def penalised(t: Tensor, limit: float | Tensor, weight: float) -> Tensor:
    """Return t; its gradient is that of the loss plus weight · mean max(|t| - limit, 0)².

    The term belongs to what makes t, and so needs no place in the loss of whoever trains it.

    Examples:
        >>> import torch, unproject as up
        >>> t = torch.tensor([1.0, 12.0], requires_grad=True)
        >>> up.ops.penalised(t, limit=10.0, weight=0.5).sum().backward()
        >>> t.grad
        tensor([1., 2.])
    """
    same: Tensor = _Penalised.apply(t, limit, weight)  # pyright: ignore[reportAssignmentType]
    return same


class _Penalised(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, t: Tensor, limit: float | Tensor, weight: float) -> Tensor:
        ctx.save_for_backward(t)
        ctx.limit, ctx.weight = limit, weight
        return t.view_as(t)

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None, None]:
        (t,) = ctx.saved_tensors
        beyond = t - t.clamp(-ctx.limit, ctx.limit)
        return gradients[0] + 2 * ctx.weight / t.numel() * beyond, None, None
