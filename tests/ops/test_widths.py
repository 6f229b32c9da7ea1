"""Local widths against SciPy's chessboard distance."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy import ndimage

from unproject.ops import local_widths


@pytest.mark.parametrize("seed", range(3))
def test_of_a_mask_it_is_twice_the_chessboard_distance_less_one(seed: int) -> None:
    noise = np.random.default_rng(seed).normal(size=(20, 33))
    mask = ndimage.gaussian_filter(noise, 2.5) > -0.1
    distance = ndimage.distance_transform_cdt(np.pad(mask, 1), "chessboard")[1:-1, 1:-1]  # pyright: ignore
    expected = np.clip(2 * distance - 1, 0, 9)  # five erosions: a quarter of 20
    assert (expected >= 5).any() and (expected == 3).any()
    found = local_widths(torch.from_numpy(np.stack([mask, ~mask])).float())
    assert torch.equal(found[0], torch.from_numpy(expected).float()) and not found[1][mask].any()


def test_widths_end_at_half_the_picture() -> None:
    assert local_widths(torch.ones(1, 20, 40)).max() == 9


def test_the_width_of_a_soft_bar_lies_between_those_of_its_rows() -> None:
    bar = torch.zeros(1, 16, 16)
    bar[:, 4:7] = 1
    bar[:, 7] = 0.5  # three and a half rows
    assert local_widths(bar)[0, 5, 8] == 3 and local_widths(bar)[0, 6, 8] == 2 and local_widths(bar)[0, 7, 8] == 0
