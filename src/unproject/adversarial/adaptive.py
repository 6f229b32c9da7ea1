"""Adaptive: the strength of an augmentation follows the discriminator's overfitting.

A discriminator that learns its images by heart scores held-out ones like generated ones:

    r = (E D(train) - E D(held-out)) / (E D(train) - E D(generated))

is 0 without overfitting and 1 when held-out images are taken for generated ones. It does not depend on the offset and
the scale of D, which relativistic losses leave free.

References:
    Karras et al. 2020, Training Generative Adversarial Networks with Limited Data (its r_v).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor

from .._types import UserError
from .augmentation import Augmentation, AugmentationState, Sometimes

RECENT = 0.1
"""Weight of a new measurement in the running means: of so few images, one alone is noise."""


@dataclass(frozen=True)
class Adaptive(Augmentation):
    """Augment each image with a probability that rises while the overfitting r is above `target`, and falls below it.

    Every panel needs images that are held out, `Panel(..., held_out=...)`, and has a strength of its own.

    Args:
        augmentation: of those images that are augmented.
        target: r that is aimed at.
        every: updates of the discriminators between two measurements, each of which scores a batch of held-out images.
        rise: part of the budget in which the strength goes from 0 to 1 if r stays above `target`.
        start: strength at the start.
        most: strength at most: close to 1 the augmentation may leak. 0 only measures.
        penalty: factor of the gradient penalty at full strength; below, it is penalty ** (strength / most).

    Raises:
        UserError: for numbers out of range.

    References:
        Karras et al. 2020, Training Generative Adversarial Networks with Limited Data.

    Examples:
        >>> import unproject as up
        >>> state = up.Adaptive(up.Affine(), rise=0.2).begin()
        >>> state.adapt(train=1.0, held_out=0.2, generated=-1.0, progress=0.1)
        >>> state.log()
        {'strength': 0.5, 'overfitting': 0.4}
    """

    adaptive: ClassVar[bool] = True
    augmentation: Augmentation
    target: float = 0.3
    every: int = 4
    rise: float = 0.2
    start: float = 0.0
    most: float = 0.8
    penalty: float = 1.0

    def __post_init__(self) -> None:
        if not (0 < self.target < 1 and self.every >= 1 and self.rise > 0 and 0 <= self.start <= self.most <= 1):
            raise UserError(
                f"{self}: give a target between 0 and 1, every 1 or more, a positive rise, and 0 <= start <= most <= 1"
            )
        if not 0 < self.penalty < math.inf:
            raise UserError(f"{self}: give a positive factor of the penalty")

    def __call__(self, images: Tensor, rng: torch.Generator) -> Tensor:
        return Sometimes(self.augmentation, self.start)(images, rng)

    def begin(self) -> AdaptiveState:
        return AdaptiveState(self)


class AdaptiveState(AugmentationState):
    """The strength, the progress at which it last moved, and running means of r's numerator and denominator.

    The means begin at 0: their ratio is free of that.
    """

    settings: Adaptive
    strength: Tensor
    moved_at: Tensor
    gap: Tensor
    margin: Tensor

    def __init__(self, settings: Adaptive) -> None:
        super().__init__(settings)
        start = {"strength": settings.start, "moved_at": 0.0, "gap": 0.0, "margin": 0.0}
        for name, value in start.items():
            self.register_buffer(name, torch.tensor(value, dtype=torch.float64))

    def forward(self, images: Tensor, rng: torch.Generator) -> Tensor:
        return Sometimes(self.settings.augmentation, self.strength.item())(images, rng)

    def due(self, draw: int) -> bool:
        return draw % self.settings.every == self.settings.every - 1

    def adapt(self, train: float, held_out: float, generated: float, progress: float) -> None:
        self.gap += RECENT * (train - held_out - self.gap)
        self.margin += RECENT * (train - generated - self.margin)
        # A resumed run whose budget is larger is less far than it was.
        by = max(progress - self.moved_at.item(), 0.0) / self.settings.rise
        self.strength += by if self.overfitting > self.settings.target else -by
        self.strength.clamp_(0.0, self.settings.most)
        self.go_on_from(progress)

    def go_on_from(self, progress: float) -> None:
        self.moved_at.fill_(progress)

    @property
    def penalty_scale(self) -> float:
        return self.settings.penalty ** (self.strength.item() / (self.settings.most or 1.0))

    @property
    def overfitting(self) -> float:
        """r; 0 as long as generated images are scored like real ones."""
        return (self.gap / self.margin).item() if self.margin > 0 else 0.0

    def log(self) -> dict[str, Any]:
        return {"strength": round(self.strength.item(), 4), "overfitting": round(self.overfitting, 4)}
