"""Adversarial losses: functions of the logits D(y) of real and D(P(G(z), θ)) of generated images.

Logits are (B,); real[b] and fake[b] are scored by the head of the same observation.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch.nn.functional as F
from torch import Tensor


class Loss(ABC):
    """The two losses of an adversarial game.

    Examples:
        >>> import torch, unproject as up
        >>> class LeastSquares(up.Loss):
        ...     def discriminator(self, real, fake):
        ...         return (real - 1).square().mean() + fake.square().mean()
        ...     def generator(self, real, fake):
        ...         return (fake - 1).square().mean()
        >>> LeastSquares().generator(torch.zeros(4), torch.zeros(4))
        tensor(1.)
    """

    @abstractmethod
    def discriminator(self, real: Tensor, fake: Tensor) -> Tensor:
        """Return the scalar that the discriminator minimises."""

    @abstractmethod
    def generator(self, real: Tensor, fake: Tensor) -> Tensor:
        """Return the scalar that the generator minimises."""


@dataclass(frozen=True)
class Wasserstein(Loss):
    """D: E D(fake) - E D(real); G: -E D(fake). Use with `GradientPenalty`.

    References:
        Arjovsky et al. 2017, Wasserstein GAN.

    Examples:
        >>> import torch, unproject as up
        >>> up.Wasserstein().discriminator(real=torch.tensor([1.0, 2.0]), fake=torch.tensor([0.0, 1.0]))
        tensor(-1.)
    """

    def discriminator(self, real: Tensor, fake: Tensor) -> Tensor:
        return fake.mean() - real.mean()

    def generator(self, real: Tensor, fake: Tensor) -> Tensor:
        return -fake.mean()


@dataclass(frozen=True)
class Hinge(Loss):
    """D: E max(0, 1 - D(real)) + E max(0, 1 + D(fake)); G: -E D(fake).

    References:
        Lim & Ye 2017, Geometric GAN.

    Examples:
        >>> import torch, unproject as up
        >>> up.Hinge().discriminator(real=torch.tensor([1.0, 2.0]), fake=torch.tensor([0.0, 1.0]))
        tensor(1.5000)
    """

    def discriminator(self, real: Tensor, fake: Tensor) -> Tensor:
        return F.relu(1 - real).mean() + F.relu(1 + fake).mean()

    def generator(self, real: Tensor, fake: Tensor) -> Tensor:
        return -fake.mean()


@dataclass(frozen=True)
class Relativistic(Loss):
    """D: E softplus(D(fake) - D(real)); G: E softplus(D(real) - D(fake)).

    References:
        Jolicoeur-Martineau 2018, The relativistic discriminator; Huang et al. 2024, R3GAN (arXiv 2501.05441).

    Examples:
        >>> import torch, unproject as up
        >>> up.Relativistic().generator(real=torch.zeros(4), fake=torch.zeros(4))  # log 2
        tensor(0.6931)
    """

    def discriminator(self, real: Tensor, fake: Tensor) -> Tensor:
        return F.softplus(fake - real).mean()

    def generator(self, real: Tensor, fake: Tensor) -> Tensor:
        return F.softplus(real - fake).mean()


@dataclass(frozen=True)
class Logistic(Loss):
    """D: E softplus(-D(real)) + E softplus(D(fake)); G: E softplus(-D(fake)), the non-saturating loss.

    References:
        Goodfellow et al. 2014, Generative adversarial nets.

    Examples:
        >>> import torch, unproject as up
        >>> up.Logistic().discriminator(real=torch.zeros(4), fake=torch.zeros(4))  # 2 log 2
        tensor(1.3863)
    """

    def discriminator(self, real: Tensor, fake: Tensor) -> Tensor:
        return F.softplus(-real).mean() + F.softplus(fake).mean()

    def generator(self, real: Tensor, fake: Tensor) -> Tensor:
        return F.softplus(-fake).mean()
