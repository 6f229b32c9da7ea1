"""Images are scored after their gauge, by the scores of each image's own turn too."""

from __future__ import annotations

import math

import pytest
import torch

from unproject.data import digits
from unproject.domains import Images
from unproject.ops import turn_image


def test_images_are_turned_by_their_gauge_before_each_is_turned_at_random() -> None:
    """All of them turned by three directions of ten: the reflection that lines leave open is about another axis."""
    x, reference = digits(32)[:100], digits(32)[700:800]
    turned = turn_image(x, torch.full((len(x),), 3 * math.pi / 10))
    upright, found, left = (
        Images().scores(images, reference, turns=turns)["frechet_mirrored"].value
        for images, turns in ((x, None), (turned, 20), (turned, None))
    )
    assert found < 1.3 * upright and left > 3 * upright


def test_images_are_shown_as_they_are() -> None:
    x = torch.zeros(1, 1, 8, 8)
    x[..., 2:6, 2:6] = torch.tensor(1.5)  # a fit may go beyond
    shown = Images().preview(x).convert("L")
    assert [shown.getpixel(place) for place in ((0, 0), (6, 6))] == [0, 255]


def test_faint_images_are_not_empty() -> None:
    faint = torch.zeros(3, 1, 8, 8)
    faint[0, :, 2:6, 2:6], faint[1, :, 2:6, 2:6] = 0.35, 0.01
    assert Images().empty(faint).tolist() == [False, True, True]


def test_of_other_images_than_digits_it_is_said_what_scores_mean() -> None:
    noise = torch.rand(40, 1, 24, 20, generator=torch.Generator().manual_seed(0))
    with pytest.warns(UserWarning, match="do not look like handwritten digits"):
        scores = Images().scores(noise[:20], noise[20:])
    assert {"frechet", "mmd_rms", "cov_rms", "1nna_rms"} <= scores.keys()
    assert not any(name.startswith("class_") for name in scores)
    assert {"class_0", "mmd_rms"} <= Images().scores(digits(32)[:60], digits(32)[60:120]).keys()


def test_pixels_are_compared_after_the_gauge() -> None:
    x = digits(32)[:200]
    turned = turn_image(x, torch.full((len(x),), math.pi / 2))
    found, left = (Images().scores(turned, x, turns=turns)["mmd_rms"].value for turns in (4, None))
    assert found < 0.02 < 0.1 < left
