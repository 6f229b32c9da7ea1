"""Cropped: a projection whose pictures are cropped to their object, as those of a collection may be.

Pictures that were cropped and scaled one by one are not projections of objects of one size: framing is part of how they
came about. They leave the size and the place of objects open; `adversarial.Inside` keeps these within their volume.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .._types import UserError
from ..ops.framing import Box, bounding_box, framed
from .base import Projection
from .silhouette import Silhouette, Window


@dataclass(frozen=True)
class Cropped(Projection):
    """y = P(x, θ) cropped to its object, scaled and centred: the rule of `ops.framed`.

    Level views are rendered twice, the second time by a camera that sees just the crop, so that nothing is resampled.
    The crop is a constant for gradients.

    Attributes:
        silhouette: P; its `size` is that of the result.
        fill: the longer side of the object, as a share of the frame.

    Raises:
        UserError: for no size, or a share that is not above 0 and at most 1.

    Examples:
        >>> import torch, unproject as up
        >>> small, large = torch.zeros(2, 1, 16, 16, 16)
        >>> small[:, 6:10, 4:8, 6:10], large[:, 2:14, 2:14, 2:14] = 1, 1
        >>> projection = up.projections.Cropped(up.Silhouette(size=16), fill=0.75)
        >>> a, b = (projection(x, azimuth=torch.zeros(1), elevation=torch.zeros(1)) for x in (small, large))
        >>> bool(torch.allclose(a, b, atol=1e-5))
        True
    """

    silhouette: Silhouette
    fill: float = 0.85

    def __post_init__(self) -> None:
        if self.silhouette.size is None or not 0 < self.fill <= 1:
            raise UserError(f"Cropped(size={self.silhouette.size}, fill={self.fill:g}): give a size, and 0 < fill <= 1")

    def forward(self, x: Tensor, *, azimuth: Tensor, elevation: Tensor) -> Tensor:
        """Return the silhouettes (B, 1, size, size) of x (B, X, Y, Z), cropped."""
        if bool(elevation.any()):
            return self.prepare(self.silhouette(x, azimuth=azimuth, elevation=elevation))
        with torch.no_grad():
            whole = self.silhouette(x, azimuth=azimuth, elevation=elevation)
            window = self._window(bounding_box(whole), whole.shape[-1])
        return self.silhouette.seen(x, azimuth, elevation, window)

    def _window(self, box: Box, pixels: int) -> Window:
        """Return the square around the boxes in pictures of so many pixels a side."""
        row, column = box.centre
        scale = 2 * self.silhouette.viewport / pixels
        viewport = box.longer.clamp_min(1) / (2 * self.fill) * scale
        return Window(viewport, (column - pixels / 2) * scale, (pixels / 2 - row) * scale)

    def prepare(self, y: Tensor) -> Tensor:
        return framed(y, self.silhouette.size or y.shape[-1], self.fill)
