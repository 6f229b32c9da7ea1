"""Standardised: a projection whose images are brought to one mean and deviation, channel by channel.

The maps of a material have very different ranges: a specular albedo lies within 0.01 of 0.04, a normal's z within 0.1
of 1. On such ranges a discriminator learns slowly, and a gradient penalty has a different strength for each map. Real
images must go through `standardise` too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from .._types import UserError
from .base import Projection

MIDDLE, SCALE = 0.5, 0.25  # networks take images in [0, 1]: two deviations on either side of the mean


@dataclass(frozen=True)
class Standardised(Projection):
    """y = ½ + ¼ (P(x, θ) - mean) / deviation, for images (B, C, H, W) and C means and deviations.

    Raises:
        UserError: for no channels, different numbers of means and deviations, or a deviation that is not positive.

    Examples:
        >>> import torch, unproject as up
        >>> projection = up.projections.Standardised(up.Selection("specular"), mean=(0.04,), deviation=(0.01,))
        >>> y = projection(torch.full((1, 8, 4, 4), 0.05))
        >>> round(y.mean().item(), 4)
        0.75
    """

    projection: Projection
    mean: tuple[float, ...]
    deviation: tuple[float, ...]
    example_shape: ClassVar[tuple[int, ...]] = (8, 4, 4)

    def __post_init__(self) -> None:
        if not self.mean or len(self.mean) != len(self.deviation) or min(self.deviation) <= 0:
            raise UserError(
                f"Standardised: give a mean and a positive deviation a channel, not {self.mean} and {self.deviation}"
            )

    @property
    def latents(self) -> tuple[str, ...]:
        return self.projection.latents

    @property
    def optional_latents(self) -> tuple[str, ...]:
        return self.projection.optional_latents

    def forward(self, x: Tensor, **latents: Tensor) -> Tensor:
        return self.standardise(self.projection(x, **latents))

    def prepare(self, y: Tensor) -> Tensor:
        return self.standardise(self.projection.prepare(self.restore(y)))

    def from_measured(self, y: Tensor) -> Tensor:
        return self.standardise(self.projection.from_measured(y))

    def standardise(self, y: Tensor) -> Tensor:
        """Return ½ + ¼ (y - mean) / deviation."""
        mean, deviation = (y.new_tensor(values)[:, None, None] for values in (self.mean, self.deviation))
        return MIDDLE + SCALE * (y - mean) / deviation

    def restore(self, y: Tensor) -> Tensor:
        """Return the images that `standardise` gave y for."""
        mean, deviation = (y.new_tensor(values)[:, None, None] for values in (self.mean, self.deviation))
        return (y - MIDDLE) / SCALE * deviation + mean


def standardised(projection: Projection, images: Tensor, least: float = 1e-3) -> Standardised:
    """Return the projection standardised by real images (N, C, H, W): their means and deviations to three digits.

    Deviations are `least` or more.
    """
    mean, deviation = images.mean((0, 2, 3)), images.std((0, 2, 3)).clamp(min=least)
    return Standardised(
        projection, *(tuple(float(f"{v:.3g}") for v in values.tolist()) for values in (mean, deviation))
    )
