"""Sizes: the resolution that recipes of shapes and of images learn at, chosen by the data."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from .._types import UserError
from ..data import detectors_of, picture_count, side_of
from .defaults import Function, with_default

SMALL, LARGE = 32, 64
LEAST_MINUTES = 30.0
"""Shorter budgets are spent at 32³: a step at 64³ takes four times as long, and views must be found first."""

MIN_PICTURES = 1000
"""Pictures of a folder below which shapes stay at 32³: of 154 seats those of 64³ are in more pieces, and farther from
held-out pictures, than what they begin with, where the discriminators learn the few by heart."""

STEPS = 4000
"""Budget of shapes: at 64³ about half an hour on two cores."""

SIZES = (16, 32, 64, 128, 256)
"""Of shapes: generators double from 4, and discriminators halve four times."""


def check_size_of_shapes(size: int | None) -> None:
    """Raise UserError for a size, if one is given, at which shapes cannot be learned."""
    if size is not None and size not in SIZES:
        raise UserError(f"--size {size}: shapes are learned at {', '.join(map(str, SIZES))} voxels a side; give one")


def size_for(data: Path | None) -> int:
    """Return 64 if the pictures or volumes of `data` are at least 64 a side, and no folder of few, else 32."""
    side = None if data is None else side_of(data)
    if data is None or side is None or side < LARGE:
        return SMALL
    count = picture_count(data)
    return SMALL if count is not None and count < MIN_PICTURES else LARGE


def size_for_images(data: Path | None) -> int:
    """Return the size of 8, 16, 32 and 64 that is nearest to the number of detectors, by ratio; 32 for pictures.

    A picture much coarser than its lines is told from what was measured by its steps alone. More than 64 is slow on a
    processor.
    """
    detectors = None if data is None else detectors_of(data)
    return SMALL if not detectors else 2 ** min(max(round(math.log2(detectors)), 3), 6)


def _size_of_shapes(data: Path | None, arguments: Mapping[str, Any]) -> int:
    """Short budgets stay at 32³, and so does direct training: at 64³ a step of 3-D convolutions takes seven seconds."""
    minutes = arguments.get("minutes")
    short = isinstance(minutes, int | float) and minutes < LEAST_MINUTES
    return SMALL if short or arguments.get("views") == "direct" else size_for(data)


def _sized(choose: Callable[[Path | None, Mapping[str, Any]], int]) -> Callable[[Function], Function]:
    """Give a recipe function the `size` that is chosen by its `data`, unless one is given.

    The choice is its attribute `size_of_data`, which `data inspect` asks too.
    """

    def size_of(arguments: Mapping[str, Any]) -> int:
        data = arguments.get("data")
        return choose(data if data is None else Path(str(data)), arguments)

    def decorate(function: Function) -> Function:
        sized = with_default("size", size_of)(function)
        vars(sized)["size_of_data"] = choose
        return sized

    return decorate


shapes_sized_by_data = _sized(_size_of_shapes)
images_sized_by_data = _sized(lambda data, arguments: size_for_images(data))
