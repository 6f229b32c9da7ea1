"""Gradient penalties: what keeps the discriminator smooth."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor


class Penalty(ABC):
    """A term of the discriminator's loss, computed at every `every`-th step and scaled up by `every`."""

    every: int

    @abstractmethod
    def __call__(self, judge: Callable[[Tensor], Tensor], real: Tensor, fake: Tensor, rng: torch.Generator) -> Tensor:
        """The penalty; `judge` gives the logits of images whose heads are already bound."""


def squared_slopes(judge: Callable[[Tensor], Tensor], images: Tensor) -> Tensor:
    """‖∂D/∂y‖² of each image, differentiable in D's weights."""
    images = images.detach().requires_grad_()
    (slope,) = torch.autograd.grad(judge(images).sum(), images, create_graph=True)
    return slope.flatten(1).square().sum(1)


@dataclass(frozen=True)
class GradientPenalty(Penalty):
    """λ E (‖∂D/∂ŷ‖ - 1)², ŷ uniform on the segment between a real and a generated image. WGAN-GP (2017)."""

    weight: float = 10.0
    every: int = 1

    def __call__(self, judge: Callable[[Tensor], Tensor], real: Tensor, fake: Tensor, rng: torch.Generator) -> Tensor:
        u = torch.rand(len(real), generator=rng).to(real).view(-1, *[1] * (real.dim() - 1))
        slope = (squared_slopes(judge, u * real + (1 - u) * fake) + 1e-12).sqrt()
        return self.weight * self.every * (slope - 1).square().mean()


@dataclass(frozen=True)
class R1R2(Penalty):
    """γ/2 (E ‖∂D/∂y‖² over real y + the same over generated y). Roth et al. 2017, Mescheder et al. 2018."""

    gamma: float = 1.0
    every: int = 4

    def __call__(self, judge: Callable[[Tensor], Tensor], real: Tensor, fake: Tensor, rng: torch.Generator) -> Tensor:
        return self.gamma / 2 * self.every * (squared_slopes(judge, real).mean() + squared_slopes(judge, fake).mean())
