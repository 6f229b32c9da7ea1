"""Line integrals of images, as in tomography, and the sets of directions used in the experiments."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar

import torch
from torch import Tensor

from .._types import UserError
from ..ops.detectors import about_middle
from ..ops.line_integrals import strip_integrals, strip_integrals_native
from .base import Projection
from .observation import Observation
from .priors import Uniform

MAX_DIRECTIONS = 10_000
"""Of one panel; each has a head of its own."""


@dataclass(frozen=True)
class LineIntegral(Projection):
    """y = ∫ x along lines across a row of detectors at `angle`: (B, C, H, W) → (B, C, bins), in image widths.

    The detectors lie along (cos angle, sin angle), x to the right and y up. The row is centred on the image and as wide
    as the image: at angle 0 detectors integrate its columns, left to right, at 90° its rows, bottom to top. A row of
    ones gives 1. What projects outside the row of detectors is not measured. At angle + 180° the same values come in
    reverse order.

    Attributes:
        bins: number of detectors (default: the width of the image in pixels).
        unit: what a line integral of 1 is in the unit of readings that were measured (`from_measured`).
        center: the detector of these, counted from 0, that the axis of rotation projects to (default: the middle).
        fast: visit only the detectors that a pixel projects to (`ops.line_integrals`): same values, faster.

    Raises:
        UserError: for fewer than one detector, a unit that is not positive, or an image or angle of another shape.

    Examples:
        >>> import math, torch, unproject as up
        >>> image = torch.ones(1, 1, 4, 4)
        >>> up.LineIntegral()(image, angle=torch.zeros(1))
        tensor([[[1., 1., 1., 1.]]])
        >>> up.LineIntegral(bins=8)(image, angle=torch.tensor([math.pi / 4])).shape
        torch.Size([1, 1, 8])
    """

    bins: int | None = None
    fast: bool = True
    unit: float = field(default=1.0, metadata={"described": False})
    center: float | None = field(default=None, metadata={"described": False})
    linear: ClassVar[bool] = True
    example_shape: ClassVar[tuple[int, ...]] = (1, 8, 8)

    def __post_init__(self) -> None:
        if self.bins is not None and self.bins < 1:
            raise UserError(f"LineIntegral(bins={self.bins}): give at least 1 detector, or None for one a pixel")
        if not 0 < self.unit < math.inf:
            raise UserError(f"LineIntegral(unit={self.unit:g}): give a positive number")

    def forward(self, x: Tensor, *, angle: Tensor) -> Tensor:
        """Return the line integrals (B, C, bins) of x (B, C, H, W) at angle (B,), radians."""
        if x.dim() != 4 or angle.shape != x.shape[:1]:
            raise UserError(
                f"LineIntegral: give images (B, C, H, W) and one angle an image, not {tuple(x.shape)} "
                f"and {tuple(angle.shape)}"
            )
        if min(x.shape[2:]) < 1:
            raise UserError(f"LineIntegral: an image of {x.shape[2]} x {x.shape[3]} has no pixel; give at least one")
        with torch.autocast(x.device.type, enabled=False):
            x = x if x.dtype == torch.float64 else x.float()
            # On a GPU sums by scattering depend on the order of threads, and the dense areas are no burden there.
            native = self.fast and x.device.type == "cpu" and not angle.requires_grad
            project = strip_integrals_native if native else strip_integrals
            return project(x, angle.to(x), self.bins or x.shape[3])

    def from_measured(self, y: Tensor) -> Tensor:
        """Return readings (N, C, D) divided by `unit`, with `center` in their middle.

        Raises:
            UserError: if `center` is not among the detectors.
        """
        return about_middle(y, self.center, "readings") / self.unit


def directions(
    count: int = 10, spread: float = math.radians(2.5), line_integral: LineIntegral | None = None, whole: bool = False
) -> tuple[Observation, ...]:
    """Return observations of line integrals in `count` directions, evenly spaced over half a turn.

    Args:
        count: number of directions; 10 in the paper.
        spread: the angle is uniform within ±`spread` of the middle of its direction, radians; 2.5° in the paper.
        line_integral: the projection (default: `LineIntegral()`).
        whole: append the opposite directions, whose lines are the same in reverse order: 2 `count` over a whole turn.

    Raises:
        UserError: for fewer than one direction, or directions that overlap.

    Examples:
        >>> from unproject.projections import directions
        >>> [observation.name for observation in directions(3, spread=0.1)]
        ['direction-00', 'direction-01', 'direction-02']
    """
    if not 1 <= count <= MAX_DIRECTIONS or not 0 <= spread <= math.pi / 2 / count:
        raise UserError(
            f"directions({count}, spread={spread:g}): give 1 to {MAX_DIRECTIONS}, and a spread of at most half the "
            "space between two, 90° / count"
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


def opposite_directions(count: int) -> tuple[int, ...]:
    """Return, for each of 2 `count` directions over a whole turn, the opposite one, whose lines are read backwards.

    Raises:
        UserError: for fewer than one direction, or too many.

    Examples:
        >>> from unproject.projections.line_integral import opposite_directions
        >>> opposite_directions(2)
        (2, 3, 0, 1)
    """
    if not 1 <= count <= MAX_DIRECTIONS:
        raise UserError(f"{count} directions: give 1 to {MAX_DIRECTIONS}")
    return tuple((k + count) % (2 * count) for k in range(2 * count))
