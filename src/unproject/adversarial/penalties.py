"""Gradient penalties, which limit the gradient norm of the discriminator by its input."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, TypeAlias

import torch
from torch import Tensor

from .._random import shared_draws
from .._types import UserError

Discriminate: TypeAlias = Callable[[Tensor], Tensor]
"""Images (B, C, ...) to logits (B,), the head of each image fixed."""


class Penalty(ABC):
    """A term of the discriminator's loss, added at every `every`-th step and multiplied by `every`.

    Class attributes:
        replayable: whether it is a function of the images and the discriminator alone, in the same operations whatever
            their values: then a GPU may replay them (`training.graphs`).

    Examples:
        >>> import torch, unproject as up
        >>> class Drift(up.Penalty):
        ...     every = 1
        ...     def __call__(self, discriminator, real, fake, rng):
        ...         return 1e-3 * discriminator(real).square().mean()
        >>> images = torch.ones(2, 1, 4, 4)
        >>> Drift()(lambda y: y.flatten(1).sum(1), images, images, torch.Generator())
        tensor(0.2560)
    """

    every: int
    replayable: ClassVar[bool] = False

    @abstractmethod
    def __call__(self, discriminator: Discriminate, real: Tensor, fake: Tensor, rng: torch.Generator) -> Tensor:
        """Return the penalty, a scalar.

        Args:
            discriminator: gives the logits (B,) of images, the head of each image fixed.
            real, fake: paired images (B, C, ...).
            rng: the source of random draws.
        """


def squared_gradient_norms(discriminator: Discriminate, images: Tensor) -> Tensor:
    """Return ‖∂D/∂y‖² of each image, (B,), differentiable in D's weights."""
    images = images.detach().requires_grad_()
    (gradient,) = torch.autograd.grad(discriminator(images).sum(), images, create_graph=True)
    return gradient.flatten(1).square().sum(1)


def _check(penalty: Penalty, weight: float, every: int) -> None:
    if not (0 <= weight < math.inf and every >= 1):
        raise UserError(f"{penalty}: give a finite weight of at least 0, and steps of at least 1")


@dataclass(frozen=True)
class GradientPenalty(Penalty):
    """WGAN-GP: λ E (‖∂D/∂ŷ‖ - 1)², ŷ uniform on the segment between a real and a generated image.

    Args:
        weight: λ.
        every: steps between two evaluations.

    References:
        Gulrajani et al. 2017, Improved training of Wasserstein GANs.

    Examples:
        >>> import torch, unproject as up
        >>> images = torch.zeros(2, 1, 2, 2)
        >>> up.GradientPenalty()(lambda y: y.flatten(1).sum(1), images, images, torch.Generator())  # 10 (2 - 1)²
        tensor(10.)
    """

    weight: float = 10.0
    every: int = 1

    def __post_init__(self) -> None:
        _check(self, self.weight, self.every)

    def __call__(self, discriminator: Discriminate, real: Tensor, fake: Tensor, rng: torch.Generator) -> Tensor:
        source, count, own = shared_draws(rng, len(real))
        u = torch.rand(count, generator=source)[own].to(real).view(-1, *[1] * (real.dim() - 1))
        norm = (squared_gradient_norms(discriminator, u * real + (1 - u) * fake) + 1e-12).sqrt()
        return self.weight * self.every * (norm - 1).square().mean()


@dataclass(frozen=True)
class R1R2(Penalty):
    """γ/2 (E ‖∂D/∂y‖² over real y + the same over generated y).

    Args:
        gamma: γ.
        every: steps between two evaluations.

    References:
        Roth et al. 2017, Stabilizing training of GANs through regularization (R2).
        Mescheder et al. 2018, Which training methods for GANs do actually converge? (R1).

    Examples:
        >>> import torch, unproject as up
        >>> images = torch.zeros(2, 1, 2, 2)
        >>> up.R1R2(gamma=1.0, every=1)(lambda y: y.flatten(1).sum(1), images, images, torch.Generator())  # (4 + 4) / 2
        tensor(4.)
    """

    gamma: float = 1.0
    every: int = 4
    replayable: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _check(self, self.gamma, self.every)

    def __call__(self, discriminator: Discriminate, real: Tensor, fake: Tensor, rng: torch.Generator) -> Tensor:
        norms = squared_gradient_norms(discriminator, real).mean() + squared_gradient_norms(discriminator, fake).mean()
        return self.gamma / 2 * self.every * norms
