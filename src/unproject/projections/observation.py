"""Observation: a projection with a prior over its latents, the paper's index i."""

from __future__ import annotations

from dataclasses import dataclass, field
from inspect import signature

import torch
from torch import Tensor

from .._types import UserError
from .base import Projection
from .priors import Prior, Product


@dataclass(frozen=True)
class Observation:
    """An observation model: y = P_i(x, θ), θ ~ p_i.

    Attributes:
        name: identifies the observation in a panel, in logs and in data.
        projection: P_i.
        prior: p_i (default: `Product()`, which draws nothing, for a projection without latents).

    Raises:
        UserError: if the prior does not draw the latents that the projection takes, or draws others.

    Examples:
        >>> import math, torch, unproject as up
        >>> front = up.Observation("front", up.LineIntegral(), up.Uniform("angle", -0.1, 0.1))
        >>> front(torch.rand(2, 1, 8, 8), torch.Generator().manual_seed(0)).shape
        torch.Size([2, 1, 8])
        >>> up.Observation("diffuse", up.Selection("diffuse")).prior
        Product(factors=())
    """

    name: str
    projection: Projection
    prior: Prior = field(default_factory=Product)

    def __post_init__(self) -> None:
        if not isinstance(self.projection, Projection):
            raise UserError(
                f"observation {self.name!r}: its projection is a {type(self.projection).__name__}; give an object of a "
                "subclass of Projection"
            )
        wanted, drawn = set(self.projection.latents), set(self.prior.names)
        optional = sorted(self.projection.optional_latents)
        given = [name for name in signature(self.projection.forward).parameters if name in drawn - wanted - {*optional}]
        if not wanted <= drawn <= wanted.union(optional):
            raise UserError(
                f"observation {self.name!r}: {type(self.projection).__name__} takes the latents "
                f"{sorted(wanted)} but the prior draws {sorted(drawn)}; make the prior draw just those"
                + (f", and any of {optional}" if optional else "")
                + (f"; write forward(self, x, *, {given[0]}, ...): latents are keywords alone" if given else "")
            )

    def __call__(self, x: Tensor, rng: torch.Generator) -> Tensor:
        """Project a batch, each element with its own draw of θ."""
        theta = self.prior.sample(len(x), rng)
        return self.projection(x, **{name: exact(value, x) for name, value in theta.items()})


def exact(value: Tensor, x: Tensor) -> Tensor:
    """Return a latent on the device of x, in its type, or in float32 where that is too coarse for an angle."""
    return value.to(x.device, torch.promote_types(x.dtype, torch.float32))
