"""Observation: one way of looking, the paper's index i."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .._types import UserError
from .base import Projection
from .priors import Prior


@dataclass(frozen=True)
class Observation:
    """A name, a projection P_i and a prior p_i over its latents: y = P_i(x, θ), θ ~ p_i.

    It pairs with one collection of real data and one head of the discriminator. The generator's loss counts what its
    discriminator says `weight` times, and that discriminator has the recipe's gradient penalty `smoothing` times: more
    where few pictures show many things, which it would learn by heart.

    Raises:
        UserError: if the prior does not draw exactly the latents the projection takes, or for a weight or smoothing
            that is not positive.
    """

    name: str
    projection: Projection
    prior: Prior
    weight: float = 1.0
    smoothing: float = 1.0

    def __post_init__(self) -> None:
        for name in ("weight", "smoothing"):
            if not 0 < getattr(self, name) < math.inf:
                raise UserError(f"observation {self.name!r}: {name}={getattr(self, name):g}: must be positive")
        wanted, drawn = set(self.projection.latents), set(self.prior.names)
        if wanted != drawn:
            raise UserError(
                f"observation {self.name!r}: {type(self.projection).__name__} takes the latents "
                f"{sorted(wanted)} but the prior draws {sorted(drawn)}; make the prior draw just those"
            )

    def __call__(self, x: Tensor, rng: torch.Generator) -> Tensor:
        """Look at a batch once, each element with its own draw of θ."""
        theta = self.prior.sample(len(x), rng)
        return self.projection(x, **{name: value.to(x) for name, value in theta.items()})
