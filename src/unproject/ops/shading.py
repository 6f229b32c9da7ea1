"""Shading of a flat material under distant light by Monte Carlo (the paper's eq. 3), and its gradients.

    I(x, ωo) = ∫ f(x, ωi, ωo) max(cosθi, 0) L(ωi) dωi  ≈  Σ_j f(ωj) cosθj L(ωj) / Σ_k n_k p_k(ωj)

Of a pixel's samples n_d are drawn from its diffuse and n_s from its specular lobe, in proportion to their albedos, and
n_l from the light. Every sample is weighted with all three densities (Veach's balance heuristic), so that neither a
small light source nor a sharp highlight is noisy. The counts are integers, so the estimate is a smooth function of the
maps for given sample points: its gradient is exact, and unbiased for that of the integral.

This is the plain reference, in chunks of samples, so that memory grows with the pixels only. `shading_native` is the
fast implementation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import torch
from torch import Tensor
from torch.utils.checkpoint import checkpoint

from .._types import UserError
from .differences import EPSILON, CentralDifferences
from .environment import look_up, sample_environments
from .lights import Directional, Environment, Light
from .low_discrepancy import offsets, points, scramble, seeds, unit
from .maps import of_colour, specular_channels, unpack_maps
from .microfacet import (
    LEAST_ROUGHNESS,
    TINY,
    Reflection,
    cosine_density,
    lobe_density,
    reflect,
    sample_beckmann,
    sample_cosine,
)

POOL, STRATUM = 2**12, 64  # prepared light samples, and at most so many for each one that a pixel takes
CHUNK, CHUNK_OF_GPU = 2**18, 2**22  # samples computed at a time
MAX_SAMPLES = 2**20


@dataclass(frozen=True)
class Sampling:
    """Settings of the estimator.

    Attributes:
        samples: number of samples a pixel; directional light needs none, and has exact gradients whatever `gradient`.
        light: the share of samples drawn from an environment's light; 0 is the paper's scheme.
        points: "low-discrepancy", or "independent".
        gradient: "exact": the gradient of the estimate, whose samples move with the maps; less noise below a roughness
            of about 0.1. "fixed": the samples do not move; unbiased too, less noise on rough materials. "differences",
            the paper's: see `ops.differences`; where a normal is exactly z, the part of the azimuth is 0.

    Raises:
        UserError: for a number of samples or a share out of range, or an unknown setting.

    Examples:
        >>> Sampling(samples=64, gradient="fixed").points
        'low-discrepancy'
    """

    samples: int = 32
    light: float = 0.375
    points: Literal["low-discrepancy", "independent"] = "low-discrepancy"
    gradient: Literal["exact", "fixed", "differences"] = "exact"

    def __post_init__(self) -> None:
        if not isinstance(self.samples, int) or not 2 <= self.samples <= MAX_SAMPLES:
            raise UserError(f"{self.samples} samples a pixel: give from 2 to {MAX_SAMPLES}, 16 or more to see anything")
        if not 0 <= self.light < 1:
            raise UserError(f"light {self.light:g}: give the share of samples drawn from the light, from 0 to below 1")
        if self.points not in ("low-discrepancy", "independent"):
            raise UserError(f"points {self.points!r}: give 'low-discrepancy' or 'independent'")
        if self.gradient not in ("exact", "fixed", "differences"):
            raise UserError(f"gradient {self.gradient!r}: give 'exact', 'fixed' or 'differences'")


class Plan(NamedTuple):
    """What the samples of a batch depend on besides the maps."""

    lobes: int
    lights: int
    seed: Tensor
    pool: Tensor
    pool_light: Tensor
    independent: bool

    @property
    def stratum(self) -> int:
        """Number of entries of the pool for each light sample, of which a pixel takes one."""
        return self.pool.shape[1] // max(1, self.lights)


def shade(
    maps: Tensor, to_camera: Tensor, light: Light, reflection: Reflection, sampling: Sampling, jitter: Tensor
) -> Tensor:
    """Compute the radiance (B, 3, H, W) of maps; of a coloured specular albedo colour by colour, three times as long.

    Args:
        maps: (B, 8, H, W), or (B, 10, H, W) of a coloured specular albedo.
        to_camera: (B, 3, H, W), unit vectors from each texel to the camera.
        light: ambient, directional, three lamps of a colour each, or environments.
        reflection: the reflection model.
        sampling: settings of the estimator.
        jitter: (B,) in [0, 1), the seed of the sample points: equal numbers give equal results.
    """
    if isinstance(light, Directional):
        return by_colour(maps, lambda x, k: _directional(x, to_camera, light.of_colour(k), reflection))
    if specular_channels(maps) == 3:
        return by_colour(maps, lambda x, k: shade(x, to_camera, light, reflection, sampling, jitter))
    plan = plan_samples(light, sampling, jitter, maps)
    fixed = maps if sampling.gradient == "exact" else maps.detach()
    if sampling.gradient == "differences":
        return CentralDifferences.apply(maps, lambda x: _estimate(x, fixed, to_camera, light, reflection, plan))
    return _estimate(maps, fixed, to_camera, light, reflection, plan)


def by_colour(maps: Tensor, shaded: Callable[[Tensor, int], Tensor]) -> Tensor:
    """Return the radiance (B, 3, H, W) whose colour k is that of `shaded(one, k)`, which has the k_s of that colour.

    Args:
        maps: (B, 8, H, W) or (B, 10, H, W).
        shaded: (maps (B, 8, H, W), index of the colour) → radiance (B, 3, H, W).
    """
    return torch.stack([shaded(of_colour(maps, k), k)[:, k] for k in range(3)], 1)


def plan_samples(light: Light, sampling: Sampling, jitter: Tensor, like: Tensor) -> Plan:
    """Divide the samples between lobes and light, and draw those of the light for all pixels."""
    seed = seeds(jitter)
    lights = round(sampling.samples * sampling.light) if isinstance(light, Environment) else 0
    pool, pool_light = like.new_zeros(len(like), 1, 3), like.new_zeros(len(like), 1, 4)
    if isinstance(light, Environment) and lights:
        entry = torch.arange(lights * min(STRATUM, max(1, POOL // lights)), device=like.device)
        keys = [scramble((entry * 4 + k) ^ scramble(seed + 1)[:, None]) for k in range(3)]
        u = torch.stack([unit(key, like.dtype) for key in keys], -1)
        u[..., 0] = (entry + u[..., 0]) / len(entry)
        pool = sample_environments(light.environments, light.which, light.turn, u)
        radiance, density = look_up(light.environments, light.which, light.turn, pool)
        pool_light = torch.cat([radiance, density[..., None]], -1)
    return Plan(sampling.samples - lights, lights, seed, pool, pool_light, sampling.points == "independent")


def diffuse_counts(maps: Tensor, lobes: int) -> Tensor:
    """Return the number (B, H W) of diffuse lobe samples, in proportion to the albedos; each lobe has one or more."""
    named = unpack_maps(maps.detach())
    k_d, k_s = named["diffuse"].mean(1), named["specular"][:, 0]
    count = (lobes * k_d / (k_d + k_s).clamp(min=EPSILON)).round()
    # The albedos do not bound the reflection at grazing angles, so both lobes keep a sample.
    return count.clamp(min(1, lobes - 1), max(1, lobes - 1)).flatten(1)


class Pixels(NamedTuple):
    """Maps by pixel, (B, P, 1) and (B, P, 1, 3), with the direction to the camera in the frame of the normal."""

    k_d: Tensor
    k_s: Tensor
    m: Tensor
    frame: Tensor
    camera: Tensor

    def world(self, v: Tensor) -> Tensor:
        """Transform (..., 3) from the normal's frame to the material's."""
        return (v[..., None, :] @ self.frame)[..., 0, :]

    def local(self, v: Tensor) -> Tensor:
        """Transform (..., 3) from the material's frame to the normal's."""
        return (self.frame @ v[..., None])[..., 0]


def pixels_of(maps: Tensor, to_camera: Tensor) -> Pixels:
    """Rearrange maps (B, 8, H, W) and directions to the camera (B, 3, H, W) by pixel."""
    named = {name: value.flatten(2).transpose(1, 2)[:, :, None] for name, value in unpack_maps(maps).items()}
    frame = frame_of(named["normal"])
    camera = to_camera.flatten(2).transpose(1, 2)[:, :, None]
    camera = (frame @ camera[..., None])[..., 0]
    return Pixels(
        named["diffuse"],
        named["specular"][..., 0],
        named["roughness"][..., 0].clamp(min=LEAST_ROUGHNESS),
        frame,
        camera,
    )


def frame_of(normal: Tensor) -> Tensor:
    """Return two tangents and the normal as rows, (..., 3, 3); the normal is normalised and needs z > -1."""
    x, y, z = (normal / normal.square().sum(-1, keepdim=True).clamp(min=EPSILON).sqrt()).unbind(-1)
    a = -1 / (1 + z)
    rows = (1 + x * x * a, x * y * a, -x), (x * y * a, 1 + y * y * a, -y), (x, y, z)
    return torch.stack([torch.stack(row, -1) for row in rows], -2)


def reflected(pixels: Pixels, i: Tensor, reflection: Reflection) -> Tensor:
    """Return f cosθi (B, P, S, 3) for directions i in the normal's frame."""
    base = reflection.base(pixels.k_d, pixels.k_s[..., None], pixels.camera[..., 2:])
    lobe = reflection.lobe(pixels.k_s, pixels.m, i, pixels.camera.expand_as(i))
    return base * cosine_density(i)[..., None] + lobe[..., None]


def _directional(maps: Tensor, to_camera: Tensor, light: Directional, reflection: Reflection) -> Tensor:
    pixels = pixels_of(maps, to_camera)
    value = math.pi * reflected(pixels, pixels.local(light.direction[:, None, None].to(maps)), reflection)
    return value[:, :, 0].transpose(1, 2).reshape(len(maps), 3, *maps.shape[2:])


def _estimate(
    maps: Tensor, drawn_from: Tensor, to_camera: Tensor, light: Light, reflection: Reflection, plan: Plan
) -> Tensor:
    """Sum over chunks of samples; for the gradient a chunk is computed again rather than stored."""

    def part(maps: Tensor, drawn_from: Tensor, chunk: Tensor, of_light: bool) -> Tensor:
        source = pixels_of(drawn_from, to_camera)
        # A facet that faces away from the camera has no specular reflection: all samples are diffuse.
        diffuse = torch.where(source.camera[:, :, 0, 2] > TINY, counts, plan.lobes)
        draw = _light_samples if of_light else _lobe_samples
        direction, radiance, weight = draw(source, light, diffuse, plan, chunk)
        pixels = source if maps is drawn_from else pixels_of(maps, to_camera)
        value = reflected(pixels, pixels.local(direction), reflection)
        return (value * radiance * weight[..., None]).sum(2)

    counts = diffuse_counts(drawn_from, plan.lobes)
    most = CHUNK_OF_GPU if maps.is_cuda else CHUNK
    size = max(1, most // max(1, maps.shape[0] * maps.shape[2] * maps.shape[3]))
    keep = torch.is_grad_enabled() and maps.requires_grad
    total = maps.new_zeros(len(maps), maps.shape[2] * maps.shape[3], 3)
    for chunk, of_light in _chunks(plan, size, maps.device):
        arguments = (maps, drawn_from, chunk, of_light)
        total = total + (again(part, *arguments) if keep else part(*arguments))
    return total.transpose(1, 2).reshape(len(maps), 3, *maps.shape[2:])


def again(part: Callable[..., Tensor], *arguments: Any) -> Tensor:
    """Compute a part, and once more for its gradient; it draws nothing from PyTorch's generators."""
    found = checkpoint(part, *arguments, use_reentrant=False, preserve_rng_state=False)
    assert isinstance(found, Tensor)
    return found


def _chunks(plan: Plan, size: int, device: torch.device) -> Iterator[tuple[Tensor, bool]]:
    for count, of_light in ((plan.lobes, False), (plan.lights, True)):
        for chunk in torch.arange(count, device=device).split(size):
            yield chunk, of_light


Drawn = tuple[Tensor, Tensor, Tensor]
"""Directions in the material's frame, their radiance, and one over the density of all samples together."""


def _lobe_samples(pixels: Pixels, light: Light, diffuse: Tensor, plan: Plan, chunk: Tensor) -> Drawn:
    dtype, count = pixels.m.dtype, pixels.m.shape[1]
    u, v = (points(offsets(plan.seed, count, k), chunk, k, dtype, plan.independent) for k in range(2))
    half = sample_beckmann(u, v, pixels.m)
    from_lobe = reflect(pixels.camera, half)
    local = torch.where((chunk < diffuse[..., None])[..., None], sample_cosine(u, v), from_lobe)
    direction = pixels.world(local)
    if isinstance(light, Environment):
        radiance, light_density = look_up(light.environments, light.which, light.turn, direction)
    else:
        radiance, light_density = torch.ones_like(direction), torch.zeros_like(u)
    return direction, radiance, _weight(pixels, local, light_density, diffuse, plan)


def _light_samples(pixels: Pixels, light: Light, diffuse: Tensor, plan: Plan, chunk: Tensor) -> Drawn:
    shift = offsets(plan.seed, pixels.m.shape[1], 2)[..., None]
    if plan.independent:
        entry = scramble(shift + chunk * 0x9E3779B9) % plan.pool.shape[1]
    else:
        entry = chunk * plan.stratum + shift % plan.stratum
    batch = torch.arange(len(entry), device=entry.device)[:, None, None]
    direction, value = plan.pool[batch, entry], plan.pool_light[batch, entry]
    return direction, value[..., :3], _weight(pixels, pixels.local(direction), value[..., 3], diffuse, plan)


def _weight(pixels: Pixels, i: Tensor, light_density: Tensor, diffuse: Tensor, plan: Plan) -> Tensor:
    n_d = diffuse[..., None]
    lobe = lobe_density(i, pixels.camera.expand_as(i), pixels.m)
    density = n_d * cosine_density(i) + (plan.lobes - n_d) * lobe + plan.lights * light_density
    # Where density is 0, as of samples below the horizon, nothing is drawn: their weight must not be 1 / 0 either when
    # differences of the normal lift them above it.
    return torch.where(density > EPSILON, 1 / density.clamp(min=EPSILON), 0)
