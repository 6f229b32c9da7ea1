"""Cropped: silhouettes that were cropped one by one, and the projection whose pictures they can be.

Pictures that were cropped and scaled one by one are not projections of objects of one size: framing is part of how they
came about. But level orthographic views of one object are all equally high. So pictures are framed anew, to one height:
then they are projections of objects of this height, in the middle of the picture, and the size of objects is settled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from .._types import UserError
from ..ops.framing import Box, bounding_box, framed, resampled
from .base import Projection
from .silhouette import Silhouette, Window
from .view import View, either, varies

MARGIN, STEP = 1.25, 0.15
"""How much wider the picture is in which an object in perspective is looked for, and steps of perspective there."""


@dataclass(frozen=True)
class Cropped(Projection):
    """y = P(x, θ) with the object in the middle, as high as it is in a level view.

    Level views are moved to the middle from left to right only, by the camera, so that nothing is resampled. Tilted
    ones are scaled by the ratio of the heights of the level view (the one along z) and of the tilted one, and centred;
    those in perspective or rolled too, but by the camera. Where the object is in the picture counts as constant for
    gradients in x, but not for those in the latents.

    Attributes:
        silhouette: P; its `size` is that of the result.
        height: of the objects that pictures are framed to (`prepare`), as a share of the frame. Objects that are wider
            than the frame are cut at its sides: made smaller, they would not have this height.

    Raises:
        UserError: for no size, or a height that is not above 0 and at most 1.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.zeros(2, 16, 16, 16)
        >>> x[0, 6:10, 4:12, 6:10], x[1, 9:13, 4:12, 6:10] = 1, 1
        >>> projection = up.projections.Cropped(up.Silhouette(size=16), height=0.5)
        >>> y = projection(x, azimuth=torch.zeros(2), elevation=torch.zeros(2))
        >>> bool(torch.allclose(y[0], y[1], atol=1e-5))
        True
        >>> bool(torch.allclose(projection.prepare(y), y, atol=1e-5))
        True
    """

    silhouette: Silhouette
    height: float = 0.85

    def __post_init__(self) -> None:
        if self.silhouette.size is None or not 0 < self.height <= 1:
            raise UserError(f"{self}: give the silhouette a size, and a share of the frame above 0 and at most 1")

    @property
    def optional_latents(self) -> tuple[str, ...]:
        """The latents that a prior may leave out: those of the silhouette."""
        return self.silhouette.optional_latents

    def forward(
        self,
        x: Tensor,
        *,
        azimuth: Tensor,
        elevation: Tensor,
        perspective: Tensor | None = None,
        roll: Tensor | None = None,
    ) -> Tensor:
        """Return the silhouettes (B, 1, size, size) of x (B, X, Y, Z); latents are (B,)."""
        view = self.silhouette.view(x, azimuth, elevation, perspective, roll)
        fixed = self.silhouette.camera == "perspective"
        return either(view.upright() | fixed, self._upright, self._in_perspective, x, view)

    def _upright(self, x: Tensor, view: View) -> Tensor:
        if not varies(view.elevation) and not varies(view.roll):
            level = bounding_box(self.silhouette.seen(x.detach(), view))
            return self.silhouette.seen(x, view, Window(self.silhouette.viewport, self._right(level)))
        tilted = self.silhouette.seen(x, view)
        box = self._box(x, view, tilted)
        return resampled(tilted, box.centre, box.height / self._level_height(x), tilted.shape[-1])

    def _in_perspective(self, x: Tensor, view: View) -> Tensor:
        """Aim at the object by its box in a wide picture, so that none is cut off and nothing is resampled."""
        size = self.silhouette.size or 1
        fine = 3 * size // 2  # these pixels are about as wide as those of the result
        finder = replace(self.silhouette, size=fine)
        # In steps, so that between them pixels of the wide picture stay where they are, and the box is smooth.
        wide = MARGIN * self.silhouette.viewport * (1 + (view.perspective.detach() / STEP).ceil() * STEP)
        with torch.set_grad_enabled(view.learned()):
            box = bounding_box(finder.seen(x.detach(), view, Window(wide)), differentiable=True)
            row, column = (place * 2 / fine - 1 for place in box.centre)
            ratio = box.height / fine * size / self._level_height(x)
            window = Window(wide * ratio, wide * column, -wide * row)
        return self.silhouette.seen(x, view, window)

    def _box(self, x: Tensor, view: View, silhouettes: Tensor) -> Box:
        if not view.learned():
            return bounding_box(silhouettes)
        return bounding_box(self.silhouette.seen(x.detach(), view), differentiable=True)

    def _level_height(self, x: Tensor) -> Tensor:
        return bounding_box(self.silhouette.front(x.detach())).height

    def _right(self, box: Box) -> Tensor:
        """Return how far the middle of the box lies to the right of the picture's, in units of the volume."""
        size = self.silhouette.size or 1
        return (box.centre[1] * 2 / size - 1) * self.silhouette.viewport

    def prepare(self, y: Tensor) -> Tensor:
        """Return silhouettes (N, 1, H, W) framed to the common height."""
        return framed(y, self.silhouette.size or y.shape[-1], self.height, width=math.inf)
