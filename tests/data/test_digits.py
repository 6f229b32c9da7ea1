"""The embedded digits: real ones, white on black, with a margin, and some held out."""

from __future__ import annotations

import pytest
import torch

from unproject.data import digits


@pytest.mark.parametrize("size", [16, 28, 32])
def test_they_fill_the_middle(size: int) -> None:
    images = digits(size)
    assert images.shape == (1500, 1, size, size) and images.min() == 0 and images.max() == 1
    margin = (size - size * 3 // 4) // 2
    assert not images[..., :margin, :].any() and not images[..., :margin].any()
    assert images[..., margin : margin + 1, :].any()


def test_others_are_held_out() -> None:
    here, there = digits(16).flatten(1), digits(16, held_out=True).flatten(1)
    assert len(there) == 297
    assert torch.cdist(there, here).min() > 0.1


def test_the_first_is_a_zero_and_the_second_a_one() -> None:
    zero, one = digits(32)[:2, 0]
    assert zero[16, 16] < 0.1 and zero[16, 8:14].max() > 0.5 and zero[16, 18:24].max() > 0.5
    assert one[16, 14:20].max() > 0.5
