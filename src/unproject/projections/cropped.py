"""Cropped: a projection whose pictures are cropped to their object, as those of a collection may be.

Pictures that were cropped and scaled one by one are not projections of objects of one size: framing is part of how they
came about. The size and the place of objects are left open by them; `adversarial.Inside` keeps objects within their volume.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor

from .._types import UserError
from ..ops.framing import framed
from .base import Projection


@dataclass(frozen=True)
class Cropped(Projection):
    """y = P(x, θ) cropped to its object, scaled and centred (`ops.framed`).

    Attributes:
        projection: P, which makes silhouettes (B, 1, H, W).
        size: pixels a side.
        fill: the longer side of the object, as a share of the frame.

    Raises:
        UserError: for less than one pixel, or a share that is not above 0 and at most 1.

    Examples:
        >>> import torch, unproject as up
        >>> small, large = torch.zeros(2, 1, 16, 16, 16)
        >>> small[:, 6:10, 4:8, 6:10], large[:, 2:14, 2:14, 2:14] = 1, 1
        >>> projection = up.projections.Cropped(up.Silhouette(), size=16, fill=0.75)
        >>> a, b = (projection(x, azimuth=torch.zeros(1), elevation=torch.zeros(1)) for x in (small, large))
        >>> bool(torch.allclose(a, b, atol=1e-5))
        True
    """

    projection: Projection
    size: int
    fill: float = 0.85

    def __post_init__(self) -> None:
        if self.size < 1 or not 0 < self.fill <= 1:
            raise UserError(f"Cropped(size={self.size}, fill={self.fill:g}): give 1 pixel or more, and 0 < fill <= 1")

    @property
    def latents(self) -> tuple[str, ...]:
        return self.projection.latents

    def forward(self, x: Tensor, **latents: Tensor) -> Tensor:
        return self.prepare(self.projection(x, **latents))

    def prepare(self, y: Tensor) -> Tensor:
        return framed(y, self.size, self.fill)
