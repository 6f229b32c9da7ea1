"""FramedSilhouette: silhouettes cropped to their object, whatever its size and place, as those of a folder are.

Where objects have sizes of their own, as those that were learned of pictures that are not cropped, a cropped picture
says nothing of them; so neither may the silhouette that it is compared with.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from torch import Tensor

from .._types import UserError
from ..ops.framing import framed
from .base import Projection
from .silhouette import Silhouette


@dataclass(frozen=True)
class FramedSilhouette(Projection):
    """y = P(x, θ), its object in the middle and `fill` of the frame long on its longer side.

    Where the object is in the picture counts as constant for gradients, as it does for `Cropped`.

    Attributes:
        silhouette: P, with a size.
        fill: the longer side of the object, as a share of the frame.

    Raises:
        UserError: for no size, or a fill that is not above 0 and at most 1.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.zeros(2, 16, 16, 16)
        >>> x[0, 4:12, 4:12, 4:12], x[1, 1:5, 9:13, 6:10] = 1, 1
        >>> y = up.projections.FramedSilhouette(up.Silhouette(size=16), 0.75)(x, azimuth=torch.zeros(2))
        >>> bool(torch.allclose(y[0], y[1], atol=1e-5)), round(y[0].mean().item(), 3)
        (True, 0.562)
    """

    silhouettes: ClassVar[bool] = True
    silhouette: Silhouette
    fill: float = 0.85

    def __post_init__(self) -> None:
        if self.silhouette.size is None or not 0 < self.fill <= 1:
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
        elevation: Tensor | None = None,
        perspective: Tensor | None = None,
        roll: Tensor | None = None,
    ) -> Tensor:
        """Return the silhouettes (B, 1, size, size) of x (B, X, Y, Z); latents are (B,)."""
        theta = {"elevation": elevation, "perspective": perspective, "roll": roll}
        given = {name: value for name, value in theta.items() if value is not None}
        return self.prepare(self.silhouette(x, azimuth=azimuth, **given))

    def prepare(self, y: Tensor) -> Tensor:
        """Return silhouettes (N, 1, H, W) framed in the same way."""
        return framed(y, self.silhouette.size or y.shape[-1], self.fill)
