"""Images: (N, 1 or 3, H, W) in [0, 1]."""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from PIL import Image
from torch import Tensor

from .. import export
from ..data import Collection, read
from ..metrics import (
    Gauge,
    Score,
    apply_to_images,
    are_digits,
    image_scores,
    line_scores,
    pixel_scores,
    turned_scores,
)
from ..projections.observation import Observation
from .domain import Domain
from .views import cover_half_a_turn, view_bins

NO_DIGITS = (
    "the references do not look like handwritten digits, white on black: frechet, kernel, precision, recall, "
    "density and coverage are on features of a classifier of digits and say little of others; mmd_rms, cov_rms and "
    "1nna_rms are of pixels, of anything"
)
DARK = 0.02
"""Images no pixel of which is brighter are empty; wide faint objects have readings like small bright ones."""
DIRECTIONS = 10
"""Of the lines whose group samples are scored up to, if the data do not say: the paper's."""


@dataclass(frozen=True)
class Images(Domain):
    """Images (N, 1, H, W) in [0, 1], or in colour (N, 3, H, W); turned in the plane by an unknown direction's `angle`.

    Features and turns are of grey ones; images in colour are scored by their pixels.

    Examples:
        >>> import unproject as up
        >>> digits = up.data.digits(32)
        >>> {name: part.shape for name, part in up.Images().arrays(digits[:4]).items()}
        {'image': (4, 1, 32, 32)}
        >>> up.Images().preview(digits[:64]).size[0] > 256
        True
    """

    name: ClassVar[str] = "image"
    previewed: ClassVar[int] = 64
    scored: ClassVar[int] = 2000
    written: ClassVar[str] = "png"
    open_reflection: ClassVar[bool] = True
    turned_by: ClassVar[str | None] = "angle"

    def preview(self, x: Tensor) -> Image.Image:
        if x.shape[1] != 1:
            return export.picture_sheet(x, columns=math.isqrt(len(x) - 1) + 1, cell=2 * x.shape[-1] + 4)
        return export.silhouette_sheet(1 - x.clamp(0, 1), scale=2)  # silhouettes are shown dark on light

    def empty(self, x: Tensor) -> Tensor:
        return (x <= DARK).flatten(1).all(1)

    def scores(self, x: Tensor, reference: Tensor, seed: int = 0, turns: int | None = None) -> dict[str, Score]:
        if x.shape[1] != 1:
            return pixel_scores(x, reference, seed=seed)
        upright = image_scores(x, reference, bins=turns, seed=seed)
        if turns:
            x = apply_to_images(
                x, Gauge(int(upright["gauge_turn"].value), bool(upright["gauge_reflected"].value), turns)
            )
        if not are_digits(reference):
            warnings.warn(NO_DIGITS, stacklevel=2)
            upright = {name: score for name, score in upright.items() if not name.startswith("class_")}
        upright |= pixel_scores(x, reference, seed=seed)
        if x.shape[2] != x.shape[3]:
            return upright
        return upright | turned_scores(x, reference, turns // 2 if turns else DIRECTIONS, seed)

    def projection_scores(
        self, y: Tensor, reference: Tensor, seed: int = 0, silhouettes: bool = False
    ) -> dict[str, Score]:
        if reference.dim() == 3:
            return line_scores(y, reference, seed=seed)
        return super().projection_scores(y, reference, seed, silhouettes)

    def bins(self, observations: Sequence[Observation]) -> int:
        return view_bins(observations)

    def half_turn(self, observations: Sequence[Observation]) -> bool:
        return cover_half_a_turn(observations)

    def read(self, path: Path, size: int) -> Collection:
        return read(path, size, pictures="images")
