"""Maps: which channel is what, the luminance of BT.709, and normals that lean away from what is high."""

from __future__ import annotations

import math

import pytest
import torch

from unproject._types import UserError
from unproject.ops.maps import (
    are_maps,
    luminance,
    normals_of,
    of_colour,
    pack_maps,
    places,
    slopes_of,
    unpack_maps,
    with_specular,
)


@pytest.mark.parametrize("channels, specular", [(8, 1), (10, 3)])
def test_the_places_of_maps_go_by_their_number_of_channels(channels: int, specular: int) -> None:
    """Diffuse first, then the specular albedo, the roughness and the normal."""
    x = torch.arange(channels, dtype=torch.float32).view(1, -1, 1, 1).expand(2, -1, 4, 4)
    expected = {"diffuse": [0, 1, 2], "specular": [*range(3, 3 + specular)]}
    expected |= {"roughness": [3 + specular], "normal": [*range(4 + specular, channels)]}
    assert {name: part[0, :, 0, 0].tolist() for name, part in unpack_maps(x).items()} == expected
    assert all(torch.equal(x[:, place], unpack_maps(x)[name]) for name, place in places(channels).items())
    assert torch.equal(pack_maps(unpack_maps(x)), x) and are_maps(x)


@pytest.mark.parametrize("shape", [(2, 9, 4, 4), (2, 3, 4, 4), (8, 4, 4)])
def test_other_shapes_are_no_maps(shape: tuple[int, ...]) -> None:
    x = torch.zeros(shape)
    assert not are_maps(x)
    with pytest.raises(UserError, match=r"give \(B, 8, H, W\), or \(B, 10, H, W\) if the specular albedo is coloured"):
        unpack_maps(x)


def test_a_specular_albedo_of_one_channel_is_the_luminance_of_three() -> None:
    coloured = torch.rand(2, 10, 4, 4)
    one = with_specular(coloured, 1)
    torch.testing.assert_close(one[:, 3:4], luminance(coloured[:, 3:6]))
    assert torch.equal(one[:, :3], coloured[:, :3]) and torch.equal(one[:, 4:], coloured[:, 6:])
    three = with_specular(one, 3)
    assert torch.equal(three[:, 3:6], one[:, 3:4].expand(-1, 3, -1, -1)) and torch.equal(three[:, 6:], one[:, 4:])
    assert with_specular(coloured, 3) is coloured and with_specular(one, 1) is one
    torch.testing.assert_close(with_specular(three, 1), one)


def test_light_of_a_colour_meets_the_specular_albedo_of_that_colour() -> None:
    coloured = torch.rand(2, 10, 4, 4)
    for k in range(3):
        one = of_colour(coloured, k)
        assert torch.equal(one, torch.cat([coloured[:, :3], coloured[:, 3 + k : 4 + k], coloured[:, 6:]], 1))
        assert of_colour(one, k) is one


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
