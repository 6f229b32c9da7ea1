"""Matching: the generator's images are given the statistics of the second order that real ones have.

With s(y) the statistics of an image (`ops.band_statistics`), in units of the deviation of the real images and less
their mean, a moving mean m over updates of E s(P(G(z))) and d, the deviation likewise, the generator minimises

    E_j [√(1 + m_j²) + √(1 + (d_j - 1)²) - 2]

The value is that of the moving means, whose noise is small; the gradient is that of the present batch. A discriminator
has to find such statistics among all others, and to forget none; here they are given.

References:
    Salimans et al. 2016, Improved techniques for training GANs (matching of features).
    Portilla and Simoncelli 2000 (which statistics).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor, nn

from .._types import UserError
from ..ops.band_statistics import SMALLEST, band_statistics

CHUNK = 64
MIN_DEVIATION = 1e-3
"""Deviation at least, of statistics that all real images share."""


@dataclass(frozen=True)
class Matching:
    """Match the statistics of bands; `begin` makes the state of one panel.

    Args:
        weight: of its gradient at the start, where that of the panel's adversarial loss has 1, by the norms that
            `Recipe.balance_every` has measured.
        final: weight at the end, to which it falls linearly.
        memory: share of the newest batch in the moving means.
        every: updates of the generator between two with this loss, which is as many times as large then.
        alike: deviation below which statistics count as the same in all real images and have the unit 1, that of
            logarithms and correlations (default: none does). Of images without any colour nearly all statistics of
            colours are the same, and in thousandths they would outweigh the others.

    Examples:
        >>> import torch, unproject as up
        >>> real = torch.rand(32, 3, 16, 16)
        >>> up.Matching().begin(real)(real).item() < 0.01
        True
    """

    weight: float = 2.0
    final: float = 0.5
    memory: float = 0.02
    every: int = 3
    alike: float | None = field(default=None, metadata={"described": "if given"})

    def __post_init__(self) -> None:
        if self.alike is not None and not 0 < self.alike < math.inf:
            raise UserError(f"{self}: alike is a positive deviation, or left out")
        if not (0 < self.weight < math.inf and 0 <= self.final < math.inf and 0 < self.memory <= 1 and self.every >= 1):
            raise UserError(f"{self}: give a positive weight, a memory above 0 and at most 1, and every 1 or more")

    def begin(self, real: Tensor) -> MatchingState:
        """Return the state of a panel with these real images (N, C, H, W).

        Raises:
            UserError: for what are no pictures, or smaller ones than 8 pixels a side.
        """
        if real.dim() != 4 or min(real.shape[2:]) < SMALLEST:
            shape = "x".join(map(str, real.shape[1:]))
            raise UserError(f"matching: needs pictures of {SMALLEST} pixels a side or more, not {shape}; leave it out")
        return MatchingState(self, real)


class MatchingState(nn.Module):
    """Statistics of the real images, and moving means of those of generated ones, in units of the real ones.

    Attributes:
        centre, unit: mean and deviation of each statistic of the real images.
        spread: the deviation in that unit: 1, but where they are alike.
        first, second: moving means of the statistics of generated ones and of their squares.
        seen: updates so far.
    """

    centre: Tensor
    unit: Tensor
    spread: Tensor
    first: Tensor
    second: Tensor
    seen: Tensor
    norm: Tensor

    def __init__(self, settings: Matching, real: Tensor) -> None:
        super().__init__()
        self.settings = settings
        found = torch.cat([band_statistics(part) for part in real.split(CHUNK)])
        self.register_buffer("centre", found.mean(0))
        deviation = found.std(0, correction=min(1, len(found) - 1))
        alike = deviation < (settings.alike or 0.0)
        self.register_buffer("unit", deviation.clamp_min(MIN_DEVIATION).masked_fill(alike, 1.0))
        self.register_buffer("spread", torch.where(alike, deviation, 1.0), persistent=False)
        self.register_buffer("first", torch.zeros_like(self.centre))
        self.register_buffer("second", torch.zeros_like(self.centre))
        self.register_buffer("seen", torch.zeros((), dtype=torch.long))
        self.register_buffer("norm", torch.zeros((), dtype=torch.float64))

    def weight_at(self, progress: float) -> float:
        """Return the weight of an update that has this loss when `progress` of the budget is spent."""
        weight, final = self.settings.weight, self.settings.final
        return self.settings.every * (weight + (final - weight) * min(progress, 1.0))

    def due(self, step: int) -> bool:
        """Whether the generator's update of this step has this loss."""
        return step % self.settings.every == 0

    @property
    def gradient_norm(self) -> float:
        """The norm of the gradient of this loss, by which it is divided; 0 until it is measured."""
        return self.norm.item()

    @gradient_norm.setter
    def gradient_norm(self, value: float) -> None:
        self.norm.fill_(value)

    def log(self) -> dict[str, Any]:
        """Return fields for the lines of the log: the root mean square of the differences of means."""
        return {"mismatch": round(self.first.square().mean().sqrt().item(), 4)}

    def forward(
        self,
        images: Tensor,
        over_processes: Callable[[Tensor], Tensor] = lambda values: values,
        call: Callable[..., Tensor] = lambda function, inputs: function(*inputs),
    ) -> Tensor:
        """Return the loss of generated images (B, C, H, W), and take them into the moving means.

        `over_processes` returns the mean of a tensor over all processes, each of which has as many images;
        `call(function, inputs)` returns `function(*inputs)`.
        """
        s = (call(band_statistics, (images.float(),)) - self.centre) / self.unit
        now = torch.stack([s.mean(0), s.square().mean(0)])
        self.seen += 1
        rate = max(self.settings.memory, 1 / int(self.seen))
        for mean, newest in zip((self.first, self.second), over_processes(now.detach()), strict=True):
            mean.lerp_(newest, rate)
        # The values are those of the moving means, the gradients those of the present batch.
        first, second = torch.stack([self.first, self.second]) + (now - now.detach())
        deviation = (second - first.square()).clamp_min(1e-6).sqrt()
        return (_length(first) + _length(deviation - self.spread)).mean()


def _length(z: Tensor) -> Tensor:
    """√(1 + z²) - 1: z²/2 of small z; of large ones, as at the start, the gradient is bounded."""
    return (1 + z.square()).sqrt() - 1
