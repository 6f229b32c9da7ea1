"""What a generator makes right now, as one picture."""

from __future__ import annotations

from pathlib import Path

from torch import Tensor

from ..export import contact_sheet, silhouette_sheet
from ..networks import Generator

SHAPES, IMAGES = 6, 64


def save_samples(generator: Generator, path: Path) -> None:
    """Things of the same codes at every call, so that pictures of a run can be compared: six shapes, or 64 images."""
    x: Tensor = generator.sample(SHAPES, seed=0, batch=SHAPES)
    if x.shape[1] <= 4:  # channels of an image
        silhouette_sheet(generator.sample(IMAGES, seed=0), path, scale=2)
    else:
        contact_sheet(x, path, size=96)
