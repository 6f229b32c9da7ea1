"""Pyramids: levels of the right size, and each wave in the band of its length."""

from __future__ import annotations

import math

import pytest
import torch

from unproject.ops.pyramids import gaussian_pyramid, laplacian_pyramid


@pytest.mark.parametrize("size, sides", [(64, [64, 32, 16]), (33, [33, 17]), (31, [31, 16]), (30, [30])])
def test_levels_of_the_pyramid(size: int, sides: list[int]) -> None:
    flat = laplacian_pyramid(torch.full((1, 2, size, size + 3), 0.25), 16)
    assert [band.shape[-2] for band in flat] == sides
    assert all(band.abs().max() < 1e-6 for band in flat[:-1]) and (flat[-1] - 0.25).abs().max() < 1e-6


def test_bands_hold_what_their_scale_holds() -> None:
    # A wave of 4 texels is in the finest band, one of 32 is in the rest.
    wave = [torch.sin(torch.arange(64) * 2 * math.pi / period).expand(1, 1, 64, 64) for period in (4, 32)]
    fine, coarse = (torch.stack([band.std() for band in laplacian_pyramid(x, 16)]) for x in wave)
    assert fine[0] > 0.6 and fine[1:].max() < 0.1
    assert coarse[2] > 0.6 and coarse[:2].max() < 0.15
    assert [level.shape[-1] for level in gaussian_pyramid(wave[0], 16)] == [64, 32, 16]
