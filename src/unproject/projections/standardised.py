"""A projection whose result is brought to one mean and deviation, channel by channel.

What is judged together should be of one size: a specular albedo lies within 0.01 of 0.04, a normal's z within 0.1 of
1, and a discriminator, and the penalty on its gradient, would see neither. Real images go through `standardise` before.
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
        UserError: for no channels, as many means as not deviations, or a deviation that is not positive.
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

    def forward(self, x: Tensor, **latents: Tensor) -> Tensor:
        return self.standardise(self.projection(x, **latents))

    def standardise(self, y: Tensor) -> Tensor:
        mean, deviation = (y.new_tensor(values)[:, None, None] for values in (self.mean, self.deviation))
        return MIDDLE + SCALE * (y - mean) / deviation

    def restore(self, y: Tensor) -> Tensor:
        """What `standardise` was given."""
        mean, deviation = (y.new_tensor(values)[:, None, None] for values in (self.mean, self.deviation))
        return (y - MIDDLE) / SCALE * deviation + mean


def standardised(projection: Projection, images: Tensor, least: float = 1e-3) -> Standardised:
    """With the means and deviations of real images (N, C, H, W), to three digits; no deviation is below `least`."""
    mean, deviation = images.mean((0, 2, 3)), images.std((0, 2, 3)).clamp(min=least)
    return Standardised(
        projection, *(tuple(float(f"{v:.3g}") for v in values.tolist()) for values in (mean, deviation))
    )


def restored(projection: Projection, images: Tensor) -> Tensor:
    """Images as they were before a `Standardised` projection brought them to one size; others as they are."""
    return projection.restore(images) if isinstance(projection, Standardised) else images
