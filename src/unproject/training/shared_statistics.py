"""Batch normalisation over the batches of all processes, so that `world` batches of b count as one of world · b.

With m and s the mean and the mean square of a channel in the batch of a process,

    μ = mean over processes of m,    σ² = mean over processes of s - μ²

both differentiable: m and s of each process have a part 1 / world in the loss of every other one.
What torch calls SyncBatchNorm is for CUDA alone.
"""

from __future__ import annotations

from typing import Any

import torch
import torch.distributed as dist
from torch import Tensor, nn
from torch.nn.modules.batchnorm import _BatchNorm


class MeanOverProcesses(torch.autograd.Function):
    """The mean of a tensor over the processes; its gradient is the mean of theirs."""

    @staticmethod
    def forward(ctx: Any, values: Tensor) -> Tensor:
        return _mean(values)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        return _mean(gradient)


def _mean(values: Tensor) -> Tensor:
    total = values.contiguous().clone()
    dist.all_reduce(total)
    return total / dist.get_world_size()


def share_statistics(module: nn.Module) -> nn.Module:
    """Let the batch normalisations of a module take their statistics over all processes while it trains."""
    if not dist.is_initialized() or dist.get_world_size() == 1:
        return module
    for part in module.modules():
        if isinstance(part, _BatchNorm) and not isinstance(part, SharedStatistics):
            # The class alone changes: names of weights, and so checkpoints, are those of one process.
            part.__class__ = type(f"Shared{type(part).__name__}", (SharedStatistics, type(part)), {})
    return module


class SharedStatistics(_BatchNorm):
    """A batch normalisation whose statistics in training are those of all processes."""

    def forward(self, input: Tensor) -> Tensor:
        if not self.training:
            return super().forward(input)
        axes = [axis for axis in range(input.dim()) if axis != 1]
        moments = torch.stack([input.mean(axes), input.square().mean(axes)])
        mean, square = MeanOverProcesses.apply(moments)
        variance = (square - mean.square()).clamp_min(0.0)
        self._remember(mean.detach(), variance.detach(), input.numel() // input.shape[1] * dist.get_world_size())
        shape = (1, -1, *[1] * (input.dim() - 2))
        y = (input - mean.view(shape)) * (variance + self.eps).rsqrt().view(shape)
        return y if self.weight is None else y * self.weight.view(shape) + self.bias.view(shape)

    @torch.no_grad()
    def _remember(self, mean: Tensor, variance: Tensor, count: int) -> None:
        """Move the running statistics, as `F.batch_norm` does: the variance without bias."""
        if self.running_mean is None or self.running_var is None or self.num_batches_tracked is None:
            return
        self.num_batches_tracked += 1
        rate = self.momentum if self.momentum is not None else 1 / float(self.num_batches_tracked)
        self.running_mean.lerp_(mean, rate)
        self.running_var.lerp_(variance * count / max(count - 1, 1), rate)
