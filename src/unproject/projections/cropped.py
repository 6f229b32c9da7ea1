"""Cropped: silhouettes that were cropped one by one, and the projection whose pictures they can be.

Pictures that were cropped and scaled one by one are not projections of objects of one size: framing is part of how they
came about. But level orthographic views of one object are all equally high. So pictures are framed anew, to one height:
then they are projections of objects of this height, in the middle of the picture, and the size of objects is settled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import torch
from torch import Tensor

from .._types import UserError
from ..ops.framing import bounding_box, framed
from ..ops.thin_parts import with_thin_parts
from .base import Projection
from .silhouette import Silhouette, Window
from .view import View, either

MARGIN, STEP = 1.25, 0.15
"""How much wider the picture is in which an object in perspective is looked for, and steps of perspective there."""


@dataclass(frozen=True)
class Cropped(Projection):
    """y = P(x, θ) with the object in the middle, as high as it is in a level view.

    The camera is aimed at the object, so that nothing is resampled. A level orthographic one is moved sideways only and
    keeps its scale; other pictures are centred, and as high as the occupied part of the volume. The object's place in
    the picture is detached for gradients in x and, in level views, in the azimuth, but not for those in learned latents
    of cameras.

    Attributes:
        silhouette: P; its `size` is that of the result.
        height: of the objects that pictures are framed to (`prepare`), as a share of the frame. Objects that are wider
            than the frame are cut at its sides: made smaller, they would not have this height.
        level: the share of a pixel that thin parts are to cover for it to be inside: `prepare` raises it to ½, so that
            parts thinner than a pixel stay in one piece (`ops.with_thin_parts`). Volumes cannot be thinner.

    Raises:
        UserError: for no size, a fixed pinhole, a height that is not above 0 and at most 1, or a level that is not
            between them.

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

    silhouettes: ClassVar[bool] = True
    silhouette: Silhouette
    height: float = 0.85
    level: float = 0.5

    def __post_init__(self) -> None:
        if self.silhouette.size is None or not 0 < self.height <= 1:
            raise UserError(f"{self}: give the silhouette a size, and a share of the frame above 0 and at most 1")
        if not 0 < self.level < 1:
            raise UserError(f"{self}: give a level between 0 and 1")
        if self.silhouette.camera == "perspective":
            raise UserError(f'{self}: this pinhole is fixed; give perspective to camera="orthographic"')

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
        return either(view.level(), self._level, self._aimed, x, view)

    def _level(self, x: Tensor, view: View) -> Tensor:
        """Move the camera sideways only: pictures of one height tell where the object begins and ends."""
        size, viewport = self.silhouette.size or 1, self.silhouette.viewport
        column = bounding_box(self.silhouette.seen(x.detach(), view)).centre[1]
        return self.silhouette.seen(x, view, Window(viewport, (column * 2 / size - 1) * viewport))

    def _aimed(self, x: Tensor, view: View) -> Tensor:
        """Aim at the object by its box in a wide picture, so that none is cut off and nothing is resampled."""
        size = self.silhouette.size or 1
        fine = 3 * size // 2  # these pixels are about as wide as those of the result
        finder = replace(self.silhouette, size=fine)
        # In steps, so that between them pixels of the wide picture stay where they are, and the box is smooth.
        wide = MARGIN * self.silhouette.viewport * (1 + (view.perspective.detach() / STEP).ceil() * STEP)
        with torch.set_grad_enabled(view.learned()):
            box = bounding_box(finder.seen(x.detach(), view, Window(wide)), differentiable=True)
            row, column = (place * 2 / fine - 1 for place in box.centre)
            window = Window(wide * box.height / fine / self._height(x), wide * column, -wide * row)
        return self.silhouette.seen(x, view, window)

    def _height(self, x: Tensor) -> Tensor:
        """Return the height of what is occupied, as a share of level pictures, (B,).

        Not that of a level view: haze that is thin from above is dense from the side, and would count in one of them.
        """
        profile = x.detach().amax((1, 3))[:, None, :, None]
        return bounding_box(profile).height / (x.shape[2] * self.silhouette.viewport)

    def prepare(self, y: Tensor) -> Tensor:
        """Return silhouettes (N, 1, H, W) framed to the common height, with thin parts."""
        small = framed(y, self.silhouette.size or y.shape[-1], self.height, width=math.inf, thin=True)
        return with_thin_parts(small, self.level)
