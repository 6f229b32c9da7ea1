"""View: the latents of a camera, one of each for every picture of a batch."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from ..ops.rotation import camera_frame

NEAREST = 0.45
"""The largest perspective: the pinhole is outside of the object's box, whose corners are √3 from the centre."""


Pictures = Callable[[Tensor, "View"], Tensor]


class View(NamedTuple):
    """Azimuth, elevation and roll in radians, and perspective, one over the distance of the pinhole; (B,) each.

    Examples:
        >>> import torch
        >>> from unproject.projections.view import View
        >>> View(*torch.tensor([[0.1, 0.2], [0.0, 0.3], [0.0, 0.25], [0.0, 0.0]])).upright()
        tensor([ True, False])
    """

    azimuth: Tensor
    elevation: Tensor
    perspective: Tensor
    roll: Tensor

    def of(self, rows: Tensor) -> View:
        """Return the views of some pictures."""
        return View(*(latent[rows] for latent in self))

    def frame(self) -> Tensor:
        """Return the cameras' frames, (B, 3, 3)."""
        return camera_frame(self.azimuth, self.elevation, self.roll if varies(self.roll) else None)

    def learned(self) -> bool:
        """Return whether a gradient by a latent is asked for."""
        return torch.is_grad_enabled() and any(latent.requires_grad for latent in self)

    def upright(self) -> Tensor:
        """Return which cameras are orthographic and not rolled, (B,) bool; none if a gradient by either is asked for.

        A gradient at 0 needs the path of the others.
        """
        if self.perspective.requires_grad or self.roll.requires_grad:
            return torch.zeros_like(self.roll, dtype=torch.bool)
        return (self.perspective == 0) & (self.roll == 0)

    def level(self) -> Tensor:
        """Return which cameras are upright at elevation 0, (B,) bool; none if a gradient by the camera is asked for."""
        if self.elevation.requires_grad:
            return torch.zeros_like(self.elevation, dtype=torch.bool)
        return self.upright() & (self.elevation == 0)


def varies(latent: Tensor) -> bool:
    """Return whether a latent has an effect: one that is not 0, or a gradient at 0."""
    return latent.requires_grad or bool(latent.any())


def either(rows: Tensor, first: Pictures, second: Pictures, x: Tensor, view: View) -> Tensor:
    """Return the pictures of `first` in some rows (B,) bool, and of `second` in others: none depends on the others."""
    if bool(rows.all()):
        return first(x, view)
    if not bool(rows.any()):
        return second(x, view)
    these, others = rows.nonzero()[:, 0], (~rows).nonzero()[:, 0]
    parts = first(x[these], view.of(these)), second(x[others], view.of(others))
    return torch.cat(parts)[torch.cat((these, others)).argsort()]
