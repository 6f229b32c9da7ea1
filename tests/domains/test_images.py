"""Images are scored after their gauge, by the scores of each image's own turn too."""

from __future__ import annotations

import math

import torch

from unproject.data import digits
from unproject.domains import Images
from unproject.ops import turn_image


def test_images_are_turned_by_their_gauge_before_each_is_turned_at_random() -> None:
    """All of them turned by three directions of ten: the reflection that lines leave open is about another axis."""
    x, reference = digits(32)[:400], digits(32)[700:1100]
    turned = turn_image(x, torch.full((len(x),), 3 * math.pi / 10))
    upright, found, left = (
        Images().scores(images, reference, turns=turns)["frechet_mirrored"].value
        for images, turns in ((x, None), (turned, 20), (turned, None))
    )
    assert found < 1.3 * upright and left > 3 * upright
