"""Maps: the luminance of BT.709, and normals that lean away from what is high."""

from __future__ import annotations

import math

import pytest
import torch

from unproject.ops.maps import luminance, normals_of, slopes_of


@pytest.mark.parametrize("channel, share", [(0, 0.2126), (1, 0.7152), (2, 0.0722)])
def test_the_luminance_of_each_colour_is_that_of_the_standard(channel: int, share: float) -> None:
    colour = torch.zeros(2, 3, 4, 4)
    colour[:, channel] = 0.5
    torch.testing.assert_close(luminance(colour), torch.full((2, 1, 4, 4), 0.5 * share))


def test_slopes_of_waves_by_hand() -> None:
    """Central differences of sin(ωx) are sin(ω) cos(ωx); x runs to the right and y up, against the rows."""
    omega = 2 * math.pi / 16
    x = torch.arange(16, dtype=torch.float64).expand(16, 16)
    y = -x.T
    wave = math.sin(omega) * torch.cos(omega * x)
    for height, expected in (((omega * x).sin(), (wave, 0 * wave)), ((omega * y).sin(), (0 * wave, wave.T))):
        for found, wanted in zip(slopes_of(height), expected, strict=True):
            torch.testing.assert_close(found, wanted, atol=1e-12, rtol=0)


def test_normals_lean_away_from_a_hilltop() -> None:
    height = torch.zeros(1, 8, 8)
    height[0, 3, 4] = 2.0  # the slope beside it is 1
    normal = normals_of(height)[0]
    half = math.sqrt(0.5)
    beside = {(3, 5): (half, 0.0), (3, 3): (-half, 0.0), (2, 4): (0.0, half), (4, 4): (0.0, -half)}
    for (row, column), (right, up) in beside.items():
        torch.testing.assert_close(normal[:, row, column], torch.tensor([right, up, half]))
    torch.testing.assert_close(normal[:, 3, 4], torch.tensor([0.0, 0.0, 1.0]))
