"""Batch normalisation over the batches of all processes, so that `world` batches of b count as one of world · b.

With x̂ = (x - μ) / σ, the means μ and E over all elements of a channel in all processes, and g the gradient by x̂,

    y = w x̂ + c,    ∂L/∂x = (g - E[g] - x̂ E[g x̂]) / σ

Each direction takes one sum over the processes; means are taken in single precision at least, and E[x²] - μ² in double,
which in single is nothing where a mean is a thousand times the deviation. Nothing can be
differentiated through twice. What torch calls SyncBatchNorm is for CUDA alone.

References:
    Ioffe & Szegedy 2015, Batch Normalization.
"""

from __future__ import annotations

from typing import Any

import torch
import torch.distributed as dist
import torch.nn.functional as F
from torch import Tensor, nn
from torch.autograd.function import once_differentiable
from torch.nn.modules.batchnorm import _BatchNorm


class SharedNorm(torch.autograd.Function):
    """x (B, C, ...) → x̂, and the mean and the variance of each channel, (C,)."""

    @staticmethod
    def forward(ctx: Any, x: Tensor, eps: float) -> tuple[Tensor, Tensor, Tensor]:
        variance, mean = torch.var_mean(widened(x), axes_of(x), correction=0)
        dtype, mean = mean.dtype, mean.double()
        mean, square = mean_over_processes(torch.stack([mean, variance.double() + mean.square()]))
        variance = (square - mean.square()).clamp_min(0.0).to(dtype)
        mean = mean.to(dtype)
        y = F.batch_norm(x, mean, variance, eps=eps)
        ctx.save_for_backward(y, (variance + eps).rsqrt())
        ctx.mark_non_differentiable(mean, variance)
        return y, mean, variance

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, None]:
        (y, scale), g = ctx.saved_tensors, widened(gradients[0])
        y = widened(y)
        axes, shape = axes_of(g), (1, -1, *[1] * (g.dim() - 2))
        means = mean_over_processes(torch.stack([g.mean(axes), (g * y).mean(axes)]))
        of_g, of_product = (value.view(shape) for value in means)
        found = (g - of_g).addcmul_(y, of_product, value=-1).mul_(scale.view(shape))
        return found.to(gradients[0].dtype), None


def widened(x: Tensor) -> Tensor:
    """Return x in single precision if it is in half of it."""
    return x.to(torch.promote_types(x.dtype, torch.float32))


def axes_of(x: Tensor) -> list[int]:
    """Return all axes but that of the channels."""
    return [axis for axis in range(x.dim()) if axis != 1]


def mean_over_processes(values: Tensor) -> Tensor:
    """Return the mean of a tensor over the processes, in its place."""
    dist.all_reduce(values)
    return values.div_(dist.get_world_size())


def share_statistics(module: nn.Module) -> nn.Module:
    """Let the batch normalisations of a module take their statistics over all processes while it trains."""
    if not dist.is_initialized() or dist.get_world_size() == 1:
        return module
    for part in module.modules():
        if isinstance(part, _BatchNorm) and not isinstance(part, SharedStatistics):
            # The class alone changes: names of weights, and so checkpoints, are those of one process.
            part.__class__ = type(f"Shared{type(part).__name__}", (SharedStatistics, type(part)), {})
    return module


def shares_statistics(module: nn.Module) -> bool:
    """Whether a module takes any statistics over all processes."""
    return any(isinstance(part, SharedStatistics) for part in module.modules())


class SharedStatistics(_BatchNorm):
    """A batch normalisation whose statistics in training are those of all processes."""

    def forward(self, input: Tensor) -> Tensor:
        if not self.training:
            return super().forward(input)
        y, mean, variance = SharedNorm.apply(input, self.eps)  # pyright: ignore[reportGeneralTypeIssues]
        self._remember(mean, variance, input.numel() // input.shape[1] * dist.get_world_size())
        if self.weight is None:
            return y
        shape = (1, -1, *[1] * (input.dim() - 2))
        return torch.addcmul(self.bias.view(shape), widened(y), self.weight.view(shape)).to(input.dtype)

    @torch.no_grad()
    def _remember(self, mean: Tensor, variance: Tensor, count: int) -> None:
        """Move the running statistics, as `F.batch_norm` does: the variance without bias."""
        if self.running_mean is None or self.running_var is None or self.num_batches_tracked is None:
            return
        self.num_batches_tracked += 1
        rate = self.momentum if self.momentum is not None else 1 / float(self.num_batches_tracked)
        self.running_mean.lerp_(mean, rate)
        self.running_var.lerp_(variance * count / max(count - 1, 1), rate)
