"""Lamps by dot products: radiance and gradients of the reference, for each model, one lamp or three, and colours."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject.ops.lights import Directional
from unproject.ops.microfacet import Reflection
from unproject.ops.plane import to_camera, towards
from unproject.ops.shading import Sampling, shade
from unproject.ops.shading_lamps import shade_lamps

MODELS = [Reflection(), Reflection("albedo"), Reflection(shadowing="cook-torrance"), Reflection("eta", 2.5)]
BATCH, SIDE = 3, 9


def maps(channels: int, roughness: float | None = None) -> Tensor:
    """With dark and bright specular albedos, tilted normals, of which some face away from lamps and cameras."""
    x = torch.rand(BATCH, channels, SIDE, SIDE, generator=generator_at(channels), dtype=torch.float64)
    specular, rough = x[:, 3 : channels - 4], x[:, channels - 4]
    specular[:, :, :3] *= 0.05
    rough.copy_(0.05 + 0.9 * rough if roughness is None else torch.full_like(rough, roughness))
    tilted = torch.cat([2 * x[:, -3:-1] - 1, 0.3 + x[:, -1:]], 1)
    x[:, -3:] = tilted / tilted.norm(dim=1, keepdim=True)
    return x


def cameras() -> Tensor:
    theta = torch.tensor([0.05, 1.39, 0.8], dtype=torch.float64)
    return to_camera(theta, torch.full_like(theta, -1.4), 4.0, SIDE, SIDE)


def lamps(count: int) -> Tensor:
    """Directions of one lamp (B, 3), or of three (B, 3, 3); at the camera, oblique and grazing."""
    theta, phi = (torch.tensor(v, dtype=torch.float64) for v in ([0.05, 0.7, 1.5], [-1.4, 0.3, 2.0]))
    around = [towards(theta, phi + 2 * math.pi * k / 3) for k in range(count)]
    return around[0] if count == 1 else torch.stack(around, 1)


def reference(x: Tensor, toward: Tensor, directions: Tensor, model: Reflection) -> Tensor:
    return shade(x, toward, Directional(directions), model, Sampling(), x.new_zeros(len(x)))


@pytest.mark.parametrize("model", MODELS, ids=str)
@pytest.mark.parametrize("channels", [8, 10])
@pytest.mark.parametrize("count", [1, 3])
def test_radiance_and_gradients_are_those_of_the_reference(count: int, channels: int, model: Reflection) -> None:
    weight = torch.rand(BATCH, 3, SIDE, SIDE, generator=generator_at(5), dtype=torch.float64)
    found = []
    for look in (lambda *given: shade_lamps(*given[:2], Directional(given[2]), given[3]), reference):
        inputs = [v.clone().requires_grad_() for v in (maps(channels), cameras(), lamps(count))]
        seen = look(*inputs, model)
        found.append((seen, *torch.autograd.grad((seen * weight).sum(), inputs)))
    (seen, by_maps, *by_rest), (expected, *expected_slopes) = found
    assert (expected > 0).double().mean() > 0.5 and (expected == 0).any()
    torch.testing.assert_close(seen, expected, rtol=1e-9, atol=1e-12)
    # By normals along themselves both have none, whatever their length.
    for slope, wanted in zip((by_maps, *by_rest), expected_slopes, strict=True):
        torch.testing.assert_close(slope, wanted, rtol=1e-7, atol=1e-9 * float(wanted.abs().max()))


@pytest.mark.parametrize("roughness", [0.0, 0.003])
def test_highlights_of_smooth_surfaces_survive_single_precision(roughness: float) -> None:
    """Mirrors that face half between lamp and camera, and so nearly that 1 - cos² would be noise."""
    x, toward, light = maps(8, roughness), cameras(), lamps(1)
    half = toward + light[:, :, None, None]
    offset = roughness * torch.randn(half.shape, generator=generator_at(6), dtype=torch.float64)
    x[:, -3:] = torch.nn.functional.normalize(torch.nn.functional.normalize(half, dim=1) + offset, dim=1)
    exact = reference(x, toward, light, Reflection())
    seen = shade_lamps(x.float(), toward.float(), Directional(light.float()), Reflection())
    assert exact.max() > 100
    torch.testing.assert_close(seen.double(), exact, rtol=0.01, atol=1e-3)


def test_each_lamp_lights_one_colour() -> None:
    x, toward, three = maps(8), cameras(), lamps(3)
    seen = shade_lamps(x, toward, Directional(three), Reflection())
    for k in range(3):
        alone = shade_lamps(x, toward, Directional(three[:, k]), Reflection())
        torch.testing.assert_close(seen[:, k], alone[:, k])
