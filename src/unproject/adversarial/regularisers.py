"""Regularisers: what the generator is asked for besides convincing projections."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class Solid:
    """-w E log(mean p): prefer fuller volumes among those with the same silhouettes.

    A ray is as dark through a shell or a haze as through a solid body. The logarithm makes the pull on each
    volume independent of how full it is; the discriminator stops it at the silhouette's edge. It does so with
    less and less force as it is taken in, so w falls in a straight line from `weight` to `final` over the budget.
    """

    weight: float = 0.1
    final: float = 0.01

    def __call__(self, x: Tensor, progress: float) -> Tensor:
        weight = self.weight + (self.final - self.weight) * min(progress, 1.0)
        return -weight * (x.flatten(1).mean(1) + 1e-6).log().mean()
