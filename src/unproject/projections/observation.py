"""Observation: one observation model, the paper's index i."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from .._types import UserError
from .base import Projection
from .priors import Prior, Product


@dataclass(frozen=True)
class Observation:
    """A name, a projection P_i and a prior p_i over its latents: y = P_i(x, θ), θ ~ p_i.

    Raises:
        UserError: if the prior does not draw exactly the latents the projection takes.
    """

    name: str
    projection: Projection
    prior: Prior = field(default_factory=Product)

    def __post_init__(self) -> None:
        wanted, drawn = set(self.projection.latents), set(self.prior.names)
        if wanted != drawn:
            raise UserError(
                f"observation {self.name!r}: {type(self.projection).__name__} takes the latents "
                f"{sorted(wanted)} but the prior draws {sorted(drawn)}; make the prior draw just those"
            )

    def __call__(self, x: Tensor, rng: torch.Generator) -> Tensor:
        """Project a batch, each element with its own draw of θ."""
        theta = self.prior.sample(len(x), rng)
        return self.projection(x, **{name: value.to(x) for name, value in theta.items()})
