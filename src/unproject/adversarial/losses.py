"""Adversarial losses: functions of the logits D(y) of real and D(P(G(z), θ)) of generated images.

Real and generated logits come in pairs made by the same way of looking.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch.nn.functional as F
from torch import Tensor


class Loss(ABC):
    """What the discriminator and what the generator minimise."""

    @abstractmethod
    def discriminator(self, real: Tensor, fake: Tensor) -> Tensor: ...

    @abstractmethod
    def generator(self, real: Tensor, fake: Tensor) -> Tensor: ...


@dataclass(frozen=True)
class Wasserstein(Loss):
    """D: E D(fake) - E D(real); G: -E D(fake). Arjovsky et al. 2017; use with `GradientPenalty`."""

    def discriminator(self, real: Tensor, fake: Tensor) -> Tensor:
        return fake.mean() - real.mean()

    def generator(self, real: Tensor, fake: Tensor) -> Tensor:
        return -fake.mean()


@dataclass(frozen=True)
class Hinge(Loss):
    """D: E max(0, 1 - D(real)) + E max(0, 1 + D(fake)); G: -E D(fake). Lim & Ye 2017."""

    def discriminator(self, real: Tensor, fake: Tensor) -> Tensor:
        return F.relu(1 - real).mean() + F.relu(1 + fake).mean()

    def generator(self, real: Tensor, fake: Tensor) -> Tensor:
        return -fake.mean()


@dataclass(frozen=True)
class Relativistic(Loss):
    """D: E softplus(-(D(real) - D(fake))); G: the same with the roles exchanged. R3GAN, arXiv 2501.05441."""

    def discriminator(self, real: Tensor, fake: Tensor) -> Tensor:
        return F.softplus(fake - real).mean()

    def generator(self, real: Tensor, fake: Tensor) -> Tensor:
        return F.softplus(real - fake).mean()


@dataclass(frozen=True)
class Logistic(Loss):
    """D: E softplus(-D(real)) + E softplus(D(fake)); G: E softplus(-D(fake)). Goodfellow et al. 2014."""

    def discriminator(self, real: Tensor, fake: Tensor) -> Tensor:
        return F.softplus(-real).mean() + F.softplus(fake).mean()

    def generator(self, real: Tensor, fake: Tensor) -> Tensor:
        return F.softplus(-fake).mean()
