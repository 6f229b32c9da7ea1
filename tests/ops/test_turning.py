"""Turning without blur: exact where it can be, there and back, lines of a turned image, against bilinear turns."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject.data import digits
from unproject.ops import rotate_image, turn_image
from unproject.ops.turning import finer
from unproject.projections.line_integral import LineIntegral

DIGITS = digits(32, held_out=True)[:64]


def all_at(angle: float) -> Tensor:
    return torch.full((len(DIGITS),), angle)


@pytest.mark.parametrize("size", [6, 7])
@pytest.mark.parametrize("times", [2, 4])
def test_finer_images_have_the_samples_and_the_waves_between(size: int, times: int) -> None:
    x = torch.rand(2, 3, size, size + 1, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(finer(x, times)[..., ::times, ::times], x, atol=1e-5, rtol=0)
    place = torch.arange(size * times) / times
    wave = torch.cos(2 * math.pi * (place - 0.3) / size)
    found = finer(wave[::times, None].expand(size, 4), times)
    torch.testing.assert_close(found, wave[:, None].expand(-1, 4 * times), atol=1e-5, rtol=0)


@pytest.mark.parametrize("quarters", [-1, 0, 1, 2])
def test_quarter_turns_are_exact(quarters: int) -> None:
    turned = turn_image(DIGITS, all_at(quarters * math.pi / 2))
    torch.testing.assert_close(turned, torch.rot90(DIGITS, quarters, (2, 3)), atol=1e-5, rtol=0)


@pytest.mark.parametrize("angle", [0.3, -1.2])
def test_it_turns_as_rotate_image_does_and_back_with_less_loss(angle: float) -> None:
    there = turn_image(DIGITS, all_at(angle))
    bilinear = rotate_image(DIGITS, all_at(angle))
    assert (there - bilinear).abs().mean() < 0.02 < DIGITS.mean()
    lost = (turn_image(there, all_at(-angle)) - DIGITS).abs().mean()
    assert lost < 0.5 * (rotate_image(bilinear, all_at(-angle)) - DIGITS).abs().mean()
    assert there.min() >= 0 and there.max() <= 1


def test_some_are_reflected_first() -> None:
    reflected = torch.arange(len(DIGITS)) % 2 == 0
    turned = turn_image(DIGITS, all_at(0.4), reflected)
    assert torch.equal(turned[1::2], turn_image(DIGITS[1::2], torch.full((32,), 0.4)))
    assert torch.equal(turned[::2], turn_image(DIGITS[::2].flip(3), torch.full((32,), 0.4)))


def test_lines_of_a_turned_image_are_those_of_the_turned_direction() -> None:
    lines, a = LineIntegral(), 0.7
    off = lines(turn_image(DIGITS, all_at(0.25)), angle=all_at(a)) - lines(DIGITS, angle=all_at(a - 0.25))
    assert off.abs().mean() < 0.03 * lines(DIGITS, angle=all_at(a)).mean()


def test_images_of_half_precision_are_turned_in_single() -> None:
    half, angle = DIGITS[:2].bfloat16(), torch.tensor([0.05, 6.1])
    assert torch.equal(turn_image(half, angle), turn_image(half.float(), angle))
