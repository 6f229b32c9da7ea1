"""Images: (N, 1, H, W) in [0, 1]."""

from __future__ import annotations

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
from .views import cover_half_a_turn, free_turns, view_bins

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
    """Grey images (N, 1, H, W) in [0, 1]; turned in the plane by an unknown direction's `angle`.

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

    def preview(self, x: Tensor) -> Image.Image:
        return export.silhouette_sheet(1 - x.clamp(0, 1), scale=2)  # silhouettes are shown dark on light

    def empty(self, x: Tensor) -> Tensor:
        return (x <= DARK).flatten(1).all(1)

    def scores(self, x: Tensor, reference: Tensor, seed: int = 0, turns: int | None = None) -> dict[str, Score]:
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
        return line_scores(y, reference, seed=seed) if reference.dim() == 3 else {}

    def turns(self, observations: Sequence[Observation], fixed: bool) -> int | None:
        if fixed or not observations[0].prior.names:
            return None
        return free_turns(observations, self.half_turn(observations))

    def bins(self, observations: Sequence[Observation]) -> int:
        return view_bins(observations)

    def half_turn(self, observations: Sequence[Observation]) -> bool:
        return cover_half_a_turn(observations)

    def read(self, path: Path, size: int) -> Collection:
        return read(path, size, pictures="images")
