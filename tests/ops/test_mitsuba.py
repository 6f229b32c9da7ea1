"""Mitsuba 3 as a witness: its rough conductor, with Schlick's Fresnel term outside and a diffuse part added.

20 uniform materials × three lights × three views: the mean radiance that our estimator finds at many samples against
the integral of Mitsuba's BSDF over the same light, within 1 %.
"""

from __future__ import annotations

import importlib.util
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject.ops.environment import look_up, prepare_environments
from unproject.ops.lights import Ambient, Directional, Environment, Light
from unproject.ops.microfacet import Reflection, lobe_density, reflect, sample_beckmann, sample_cosine
from unproject.ops.plane import towards
from unproject.ops.shading import Sampling
from unproject.ops.shading_native import shade_fast

MATERIALS, VIEWS, SIDE = 20, (0.0, 45.0, 80.0), 40
pytestmark = pytest.mark.skipif(importlib.util.find_spec("mitsuba") is None, reason="mitsuba is not installed")


def lattice(side: int) -> tuple[Tensor, Tensor]:
    at = (torch.arange(side, dtype=torch.float64) + 0.5) / side
    return at.repeat_interleave(side), (at.repeat(side) + at.repeat_interleave(side)) % 1


@pytest.fixture(scope="module")
def cases(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Tensor]:
    """Materials, views and directions, and Mitsuba's word on them."""
    rng = generator_at(0)
    drawn = torch.rand(MATERIALS, 5, generator=rng, dtype=torch.float64)
    k_d, k_s, m = 0.8 * drawn[:, :3], 0.1 + 0.9 * drawn[:, 3], 0.05 + 0.75 * drawn[:, 4]
    theta = torch.tensor(VIEWS, dtype=torch.float64).deg2rad()
    o = towards(theta, torch.full_like(theta, -math.pi / 2))
    u, v = lattice(SIDE)
    half = sample_beckmann(u, v, m[:, None])[:, None]
    i = torch.cat([reflect(o[:, None], half), sample_cosine(u, v).expand(MATERIALS, 3, -1, 3)], 2)
    light = towards(torch.tensor([0.6], dtype=torch.float64), torch.tensor([1.2], dtype=torch.float64))
    i = torch.cat([i, light.expand(MATERIALS, 3, 1, 3)], 2)
    folder = tmp_path_factory.mktemp("mitsuba")
    rows = {"alpha": m.repeat_interleave(3), "o": o.repeat(MATERIALS, 1), "i": i.flatten(0, 1)}
    np.savez(folder / "in.npz", **{name: value.numpy() for name, value in rows.items()})  # pyright: ignore[reportArgumentType]
    script = Path(__file__).with_name("mitsuba_eval.py")
    subprocess.run(
        [sys.executable, str(script), str(folder / "in.npz"), str(folder / "out.npz")], check=True, timeout=200
    )
    with np.load(folder / "out.npz") as found:
        lobe = torch.from_numpy(found["lobe"]).view(MATERIALS, 3, -1)
    return {"k_d": k_d, "k_s": k_s, "m": m, "o": o, "i": i, "lobe": lobe, "light": light}


def theirs(cases: dict[str, Tensor], fresnel: str) -> Tensor:
    """f cosθi (M, V, S, 3): k_d cosθ/π and Mitsuba's lobe times F0 + (1 - F0) (1 - cosθ)⁵, not by our `schlick`."""
    o, i, k_s = cases["o"][:, None], cases["i"], cases["k_s"][:, None, None]
    h = torch.nn.functional.normalize(i + o, dim=-1)
    f0 = torch.full_like(k_s, 0.04) if fresnel == "eta" else k_s
    term = (f0 + (1 - f0) * (1 - (o * h).sum(-1)) ** 5) * (k_s if fresnel == "eta" else 1)
    base = cases["k_d"][:, None, None].expand(-1, 3, -1, -1)
    if fresnel == "albedo":
        f0 = cases["k_s"][:, None]
        base = base * (1 - f0 - (1 - f0) * (1 - cases["o"][:, 2]) ** 5)[:, :, None, None]
    up = i[..., 2].clamp(min=0)
    return base * up[..., None] / math.pi + (term * torch.where(i[..., 2] > 0, cases["lobe"], 0))[..., None]


def lights() -> dict[str, Light]:
    small = torch.rand(1, 3, 6, 12, generator=generator_at(2), dtype=torch.float64) ** 2
    probe = torch.nn.functional.interpolate(small, size=(32, 64), mode="bicubic").clamp(min=0.01)
    zero = torch.zeros(1, dtype=torch.float64)
    return {
        "directional": Directional(towards(zero + 0.6, zero + 1.2)),
        "environment": Environment(prepare_environments(probe), torch.zeros(1, dtype=torch.long), zero),
        "constant": Ambient(),
    }


@pytest.mark.parametrize("fresnel", ["eta", "albedo"])
@pytest.mark.parametrize("kind", ["directional", "environment", "constant"])
def test_radiance_is_mitsubas(cases: dict[str, Tensor], kind: str, fresnel: str) -> None:
    light, value = lights()[kind], theirs(cases, fresnel)
    if isinstance(light, Directional):
        expected = math.pi * value[:, :, -1]
    else:
        i, o = cases["i"][:, :, :-1], cases["o"][:, None].expand(MATERIALS, -1, 2 * SIDE**2, -1)
        n = SIDE**2
        density = n * lobe_density(i, o, cases["m"][:, None, None]) + n * i[..., 2].clamp(min=0) / math.pi
        seen = torch.ones_like(i)
        if isinstance(light, Environment):
            seen = look_up(light.environments, light.which, light.turn, i.reshape(1, -1, 3))[0].view_as(i)
        weight = torch.where(i[..., 2] > 0, 1 / density.clamp(min=1e-9), 0)
        expected = (value[:, :, :-1] * seen * weight[..., None]).sum(2)
    ours = radiance(cases, light, fresnel)
    assert (ours / expected - 1).abs().max() < 0.01


def radiance(cases: dict[str, Tensor], light: Light, fresnel: str) -> Tensor:
    """(M, V, 3), by the estimator: one texel a material and view, 8192 samples, the mean of 4 seeds."""
    x = torch.zeros(MATERIALS, 3, 8, 1, 1)
    x[:, :, :3, 0, 0], x[:, :, 3, 0, 0] = cases["k_d"][:, None].float(), cases["k_s"][:, None].float()
    x[:, :, 4, 0, 0], x[:, :, 7] = cases["m"][:, None].float(), 1
    many = x.flatten(0, 1)
    count = len(many)
    camera = cases["o"].float().repeat(MATERIALS, 1)[:, :, None, None]
    if isinstance(light, Environment):
        ready = type(light.environments)(*(part.float() for part in light.environments))
        light = Environment(ready, light.which.expand(count), light.turn.float().expand(count))
    elif isinstance(light, Directional):
        light = Directional(light.direction.float().expand(count, 3))
    model, options = Reflection(fresnel), Sampling(8192)  # pyright: ignore[reportArgumentType]
    seen = [shade_fast(many, camera, light, model, options, torch.full((count,), k / 4)) for k in range(4)]
    return torch.stack(seen).mean(0)[:, :, 0, 0].view(MATERIALS, 3, 3).double()


def test_the_lobe_is_mitsubas_direction_by_direction(cases: dict[str, Tensor]) -> None:
    """With a Fresnel term of 1, where it matters: above a hundredth of the lobe's greatest value."""
    o = cases["o"][:, None].expand_as(cases["i"])
    one = torch.ones(cases["i"].shape[:-1], dtype=torch.float64)
    glass = Reflection("eta", 1e9)  # F0 = 1
    ours = glass.lobe(one, cases["m"][:, None, None].expand_as(one), cases["i"], o)
    matters = cases["lobe"] > 0.01 * cases["lobe"].amax((1, 2), keepdim=True)
    assert matters.sum() > 10_000
    assert ((ours / cases["lobe"] - 1).abs()[matters]).max() < 2e-3
