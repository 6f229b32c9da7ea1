"""Regularisers: terms of the generator's loss besides the adversarial one."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Solid:
    """-w E log(mean p): prefer the fullest volume among those with the same silhouettes.

    A thin shell can have the same silhouette as a solid body. The gradient of the logarithm does not depend on how full
    a volume is; the discriminator's gradient stops it at the outline of the silhouette. That gradient weakens during
    training, so w falls linearly from `weight` to `final` over the budget.

    Examples:
        >>> import torch, unproject as up
        >>> up.Solid()(torch.full((2, 4, 4, 4), 0.5), progress=0.0)
        tensor(0.0693)
    """

    weight: float = 0.1
    final: float = 0.01

    def __call__(self, x: Tensor, progress: float) -> Tensor:
        """Return the term of volumes x (B, X, Y, Z) when `progress`, a part of the budget in [0, 1], is spent."""
        weight = self.weight + (self.final - self.weight) * min(progress, 1.0)
        return -weight * (x.flatten(1).mean(1) + 1e-6).log().mean()
