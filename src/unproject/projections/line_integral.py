"""Line integrals of images, as a tomograph measures them, and the directions that the experiments use."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import torch
from torch import Tensor

from .._types import UserError
from ..ops.line_integrals import strip_integrals, strip_integrals_native
from .base import Projection
from .observation import Observation
from .priors import Uniform


@dataclass(frozen=True)
class LineIntegral(Projection):
    """y = ∫ x along lines across a row of detectors at `angle`: (B, C, H, W) → (B, C, bins), in image widths.

    The detectors lie along (cos angle, sin angle), x to the right and y up, centred on the image and together as wide
    as it: at 0 they see its columns, left to right, at 90° its rows, bottom to top. A row of ones measures 1. What
    falls beside the detectors is not seen. At angle + 180° the same is read in the other direction.

    Attributes:
        bins: detectors; one a pixel of the image's width unless given.
        fast: touch only the strips that a pixel falls into (`ops.line_integrals`): same values, many times sooner.

    Raises:
        UserError: for fewer than one detector.
    """

    bins: int | None = None
    fast: bool = True
    linear: ClassVar[bool] = True
    example_shape: ClassVar[tuple[int, ...]] = (1, 8, 8)

    def __post_init__(self) -> None:
        if self.bins is not None and self.bins < 1:
            raise UserError(f"LineIntegral(bins={self.bins}): give at least 1 detector, or None for one a pixel")

    def forward(self, x: Tensor, *, angle: Tensor) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        """The line integrals of x (B, C, H, W) at angle (B,), radians."""
        if x.dim() != 4 or angle.shape != x.shape[:1]:
            raise UserError(
                f"LineIntegral: give images (B, C, H, W) and one angle an image, not {tuple(x.shape)} "
                f"and {tuple(angle.shape)}"
            )
        with torch.autocast(x.device.type, enabled=False):
            x = x if x.dtype == torch.float64 else x.float()
            # On a GPU sums by scattering depend on the order of threads, and the dense areas are no burden there.
            native = self.fast and x.device.type == "cpu" and not angle.requires_grad
            look = strip_integrals_native if native else strip_integrals
            return look(x, angle.to(x), self.bins or x.shape[3])


def directions(
    count: int = 10, spread: float = math.radians(2.5), line_integral: LineIntegral | None = None, whole: bool = False
) -> tuple[Observation, ...]:
    """`count` directions evenly over half a turn, each uniform within ±`spread` radians: the paper's are 10 and 2.5°.

    With `whole` they are followed by the opposite ones, which read the same backwards: 2 `count` over a whole turn.
    """
    if count < 1 or not 0 <= spread <= math.pi / 2 / count:
        raise UserError(
            f"directions({count}, spread={spread:g}): give at least one, and a spread of at most half the space "
            "between two, 90° / count"
        )
    middles = [math.pi * k / count for k in range(2 * count if whole else count)]
    return tuple(
        Observation(
            f"direction-{k:02d}",
            line_integral or LineIntegral(),
            Uniform("angle", middle - spread, middle + spread, 2 * math.pi),
        )
        for k, middle in enumerate(middles)
    )
