"""Five light probes from formulas, for tests, examples and whoever has no photographs of light.

Each is a function of the direction d = (x, y, z), z up, and returns radiance; where φ = 90° (y) is what the camera at
its default azimuth faces. They are evaluated on a fine grid and reduced with their energy, so that a probe lights
a surface the same at every height. Small sources are larger than in nature, and dimmer, with the light of the real ones
relative to their surroundings: the sun is drawn 4° wide.

    sky       clear sky after the CIE: gradation 1 - exp(-0.32/z), times a glow about the sun, 0.91 + 10 exp(-3γ) +
              0.45 cos²γ for γ from the sun; its irradiance on the ground is a fifth to a quarter of the sun's
    overcast  the CIE's overcast sky, L = (1 + 2 z)/3 of the zenith's
    studio    a dark room, two soft boxes and a strip light
    window    a dim room, one window of six panes and what of its light floor, walls and ceiling return
    night     dark blue, a moon, and warm lamps along the horizon
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor

from ..._types import UserError
from ...ops.environment import solid_angles
from ...ops.lengths import length
from ..readers.probes import directions, resample_probe

FINEST = 256  # rows at least on which the formulas are evaluated
Colour = tuple[float, float, float]


def procedural_probes(height: int = 64) -> tuple[Tensor, list[str]]:
    """The five probes (5, 3, height, 2 height) float32 and their names; always the same.

    Raises:
        UserError: for a height below 2 or above 2048.
    """
    if not 2 <= height <= 2048:
        raise UserError(f"procedural probes: a height of {height} rows makes no sense; give 2 to 2048")
    fine = 2 * height * max(1, math.ceil(FINEST / (2 * height)))  # even: no row straddles the horizon
    d = directions(fine, 2 * fine)
    return torch.stack([resample_probe(make(d), height).float() for make in PROBES.values()]), list(PROBES)


def mixed_probes(count: int, height: int = 64, seed: int = 0) -> Tensor:
    """Light of many places (count, 3, height, 2 height): sums of the five, since light adds up.

    Σ_k w_k T_k(L_k), where L_k lights what lies flat as ambient light does, the weights w are Dirichlet with
    concentration 1/3, so that one or two of them prevail, and T turns by whole columns and tints: the logarithm of
    each channel changes by N(0, 0.1²). Probe i of a seed is the same whatever `count`.
    """
    if count < 1:
        raise UserError(f"mixed probes: count={count}; give at least 1")
    five = procedural_probes(height)[0]
    five = five * (math.pi / _upper(five))[:, None, None, None]
    made = []
    for i in range(count):
        rng = np.random.default_rng((seed, i))
        weights = rng.dirichlet(np.full(len(five), 1 / 3))
        turns = rng.integers(0, 2 * height, len(five))
        tints = torch.from_numpy(np.exp(rng.normal(0, 0.1, (len(five), 3)))).float()
        turned = torch.stack([probe.roll(int(k), dims=2) for probe, k in zip(five, turns, strict=True)])
        made.append((torch.from_numpy(weights).float()[:, None, None, None] * tints[:, :, None, None] * turned).sum(0))
    return torch.stack(made)


def daylight_probes(count: int = 64, height: int = 32) -> Tensor:
    """Light that nobody measured (count, 3, height, 2 height): one source, and the same light from everywhere.

        L(ω) = 1 - s + s π ℓ(ω) / ∫ ℓ dω,      ℓ(ω) = exp((cos γ - 1) / σ²)

    for γ from the source, which stands at the polar angle θ and the azimuth 0; turned maps have it elsewhere. s is its
    share of the light on a surface that faces it: 0 an overcast sky, 0.8 the sun in a clear one. Directions are
    equally likely by solid angle up to θ = 80°, and so is ln σ, from 6°, which 32 rows just resolve (the sun is
    sharper), to 30°, a window beside the table. s has the density 3 s²: then slopes are shaded as strongly as by
    measured light. Over all turns |ln E₊/E₋|, with E± the light on slopes of 24° that face each other, has the deciles
    0.04 (10 %), 0.34 (50 %) and 1.04 (90 %); in 45 measured probes 0.04, 0.33 and 1.03; with uniform s half of that.
    Numbers come in the order of a Sobol sequence, always the same.

    All is white, since cameras balance colours. Each map is symmetric about the plane of the azimuths 0 and π, so that
    its mirror image is the same map turned: mirror images of a photograph are as likely as the photograph.

    Raises:
        UserError: for a count below 1.

    Examples:
        >>> daylight_probes(3, 8).shape
        torch.Size([3, 3, 8, 16])
    """
    if count < 1:
        raise UserError(f"daylight probes: count={count}; give at least 1")
    cubed, across, width = torch.quasirandom.SobolEngine(3).draw(count).double().unbind(1)
    share = cubed ** (1 / 3)
    polar = torch.acos(1 - across * (1 - math.cos(math.radians(80)))).rad2deg()
    spread = torch.deg2rad(6 * (30 / 6) ** width)
    d = directions(4 * height, 8 * height)
    made = []
    for s, theta, sigma in zip(share.tolist(), polar.tolist(), spread.tolist(), strict=True):
        lobe = torch.exp((_dot(d, toward(theta, 0)) - 1) / sigma**2)
        whole = 2 * math.pi * sigma**2 * -math.expm1(-2 / sigma**2)
        made.append(resample_probe(1 - s + s * math.pi / whole * lobe, height))
    return torch.stack(made).float()[:, None].repeat(1, 3, 1, 1)


def _upper(probes: Tensor) -> Tensor:
    """(N,) irradiance on a surface that lies flat, mean of colours."""
    return torch.stack([_irradiance(probe.double()).mean() for probe in probes]).float()


def sky(d: Tensor) -> Tensor:
    """A clear sky, deep blue above and pale at the horizon, a sun 35° from the zenith, brown ground."""
    towards_sun = toward(35, 120)
    cosine = _dot(d, towards_sun)
    gamma = torch.acos(cosine.clamp(-1, 1))
    glow = 0.91 + 10 * torch.exp(-3 * gamma) + 0.45 * cosine**2
    z = d[2].clamp(min=1e-6)
    gradation = 1 - torch.exp(-0.32 / z)
    paleness = torch.exp(-3 * z) + 0.3 * torch.exp(-6 * gamma)
    blue = _mix((0.16, 0.36, 1.0), (0.80, 0.92, 1.0), paleness.clamp(max=1))
    above = gradation * glow * blue
    sun = lamp(d, towards_sun, 2.0)
    irradiance = _irradiance(above).mean()
    disc = 4.5 * irradiance / _irradiance(sun[None]).mean() * sun * _colour((1.06, 1.0, 0.90))
    return on_ground(above + disc, (0.16, 0.13, 0.09))


def overcast(d: Tensor) -> Tensor:
    """An overcast sky of the CIE, three times as bright at the zenith as at the horizon, over dull ground."""
    above = (1 + 2 * d[2].clamp(min=0)) / 3 * _colour((0.94, 0.98, 1.0))
    return on_ground(above, (0.20, 0.19, 0.17))


def studio(d: Tensor) -> Tensor:
    """A key soft box in front to the right, a weaker fill to the left, a strip light behind; the room is nearly black.

    A soft box is brightest in its middle, where the lamp stands behind its cloth.
    """
    dark = 0.015 + 0.01 * d[2].clamp(min=0)
    room = dark * _colour((1.0, 0.97, 0.93)) + 0.03 * torch.exp(-6 * (d[2] + 0.5) ** 2)
    key = 14 * panel(d, toward(48, 40), 0.42, 0.42, 0.02, 0.6) * _colour((1.0, 0.98, 0.95))
    fill = 4 * panel(d, toward(58, 165), 0.35, 0.50, 0.02, 0.6) * _colour((0.92, 0.97, 1.0))
    strip = 9 * panel(d, toward(62, 275), 0.08, 0.75, 0.01, 0.15) * _colour((1.0, 1.0, 1.0))
    return room + key + fill + strip


def window(d: Tensor) -> Tensor:
    """A room three wide, four deep and three high with a window of 2 × 3 panes above a table, in the wall at φ = 90°.

    Walls are painted pale, the floor is of wood; each point of them returns light in proportion to what it sees of the
    window (a patch's form factor: two cosines over the square of the distance). Sky fills the panes, with trees low
    in the last.
    """
    point, inward, surface = _room(d, half=(1.5, 2.0), floor=-1.0, ceiling=2.0)
    offset = torch.tensor([0.0, 2.0, 0.96], dtype=d.dtype)[:, None, None] - point
    square = (offset**2).sum(0) + 0.3
    facing = ((offset * inward).sum(0) + 0.25).clamp(min=0) * (offset[1] + 0.1).clamp(min=0)
    room = surface * (0.02 + 0.9 * facing / square**2)
    u, v = _plane(d, toward(90, 90))
    front = d[1] > 0
    panes = [(x, z) for x in (-0.21, 0.21) for z in (0.20, 0.48, 0.76)]
    glass = front * torch.stack([_box(u - x, 0.195, 0.006) * _box(v - z, 0.125, 0.006) for x, z in panes]).sum(0)
    frame = front * _box(u, 0.44, 0.006) * _box(v - 0.48, 0.44, 0.006)
    trees = 0.15 + 0.03 * torch.sin(9 * u + 1) + 0.015 * torch.sin(23 * u)
    open_sky = _step((v - trees) / 0.03 + 0.5)
    light = _mix((0.8, 1.1, 0.5), (5.2, 6.4, 8.0), open_sky * (0.7 + 0.3 * v.clamp(0, 1)))
    return room * (1 - frame) + 0.12 * frame * (1 - glass) * _colour((1.0, 0.97, 0.92)) + glass * light


def night(d: Tensor) -> Tensor:
    """A night sky, dark blue above and faintly lit at the horizon, a moon at 40°, and six street lamps with their glow.

    The ground is asphalt, with a warm pool of light beneath every lamp.
    """
    z = d[2].clamp(min=0)
    above = _mix((0.003, 0.006, 0.020), (0.030, 0.030, 0.036), torch.exp(-7 * z))
    towards_moon = toward(40, 70)
    halo = torch.exp((_dot(d, towards_moon) - 1) / 0.004)
    above = above + (18 * lamp(d, towards_moon, 1.8) + 0.05 * halo) * _colour((0.90, 0.95, 1.0))
    pools = torch.zeros_like(z)
    for polar, azimuth, strength in LAMPS:
        place, foot = toward(polar, azimuth), toward(180 - 0.85 * polar, azimuth)
        glow = 0.12 * torch.exp((_dot(d, place) - 1) / 0.006)
        above = above + strength * (30 * lamp(d, place, 1.5) + glow) * _colour((1.0, 0.62, 0.26))
        pools = pools + 0.05 * strength * torch.exp((_dot(d, foot) - 1) / 0.03)
    ground = on_ground(above, (0.06, 0.06, 0.06))
    return ground + pools * (d[2] < 0) * _colour((1.0, 0.62, 0.26))


LAMPS = ((78, 15, 1.0), (70, 52, 1.6), (82, 118, 0.6), (74, 170, 1.1), (84, 235, 0.5), (76, 310, 1.0))
"""Polar angle and azimuth in degrees, and strength, of the lamps of `night`."""

PROBES: dict[str, Callable[[Tensor], Tensor]] = {
    "sky": sky,
    "overcast": overcast,
    "studio": studio,
    "window": window,
    "night": night,
}


def toward(polar: float, azimuth: float) -> Tensor:
    """(3,) the unit vector of two angles in degrees."""
    theta, phi = math.radians(polar), math.radians(azimuth)
    return torch.tensor(
        [math.sin(theta) * math.cos(phi), math.sin(theta) * math.sin(phi), math.cos(theta)], dtype=torch.float64
    )


def lamp(d: Tensor, place: Tensor, degrees: float) -> Tensor:
    """(H, W) coverage of a disc with this angular radius about a direction; its rim takes a third of the radius."""
    angle = torch.rad2deg(2 * torch.asin((length(d - place[:, None, None], 0)[0] / 2).clamp(max=1)))
    return _step((degrees * 7 / 6 - angle) / (degrees / 3))


def panel(d: Tensor, place: Tensor, half_width: float, half_height: float, soft: float, falloff: float) -> Tensor:
    """(H, W) light of a rectangle at distance 1 that faces the origin, upright; its rim is `soft` wide.

    Towards its rim it has 1 - falloff of the light of its middle.
    """
    u, v = _plane(d, place)
    inside = _box(u, half_width, soft) * _box(v, half_height, soft) * (_dot(d, place) > 0)
    distance = ((u / half_width) ** 2 + (v / half_height) ** 2) / 2
    return inside * (1 - falloff * distance.clamp(max=1))


def on_ground(above: Tensor, albedo: Colour) -> Tensor:
    """A sky (3, H, W) above a diffuse ground, whose radiance is albedo/π times the irradiance E = ∫ L cos θ dΩ."""
    height = above.shape[1]
    ground = _irradiance(above)[:, None, None] / math.pi * _colour(albedo)
    upper = (torch.arange(height) < height // 2)[:, None]
    return torch.where(upper, above, ground)


def _irradiance(radiance: Tensor) -> Tensor:
    """(C,) irradiance from the upper hemisphere on a surface that lies flat."""
    _, height, width = radiance.shape
    cosine = directions(height, width)[2].clamp(min=0)
    return (radiance * cosine * solid_angles(height, width)).sum((1, 2))


def _room(d: Tensor, half: tuple[float, float], floor: float, ceiling: float) -> tuple[Tensor, Tensor, Tensor]:
    """Where rays from the origin meet a box: the point, the inward normal and the paint, (3, H, W) each."""
    limits = torch.stack([d[0].sign() * half[0], d[1].sign() * half[1], torch.where(d[2] > 0, ceiling, floor)])
    distance, axis = (limits / d.where(d.abs() > 1e-9, torch.full_like(d, 1e-9).copysign(d))).min(0)
    inward = -d.sign() * torch.nn.functional.one_hot(axis, 3).movedim(-1, 0)
    wood = (axis == 2) & (d[2] < 0)
    paint = torch.where(wood, _colour((0.42, 0.27, 0.15)), _colour((0.78, 0.74, 0.66)))
    return d * distance, inward, paint


def _plane(d: Tensor, place: Tensor) -> tuple[Tensor, Tensor]:
    """Coordinates to the right and up, as seen from the origin, in the plane at distance 1 that faces it."""
    right = torch.linalg.cross(place, torch.tensor([0.0, 0.0, 1.0], dtype=d.dtype))
    right = right / right.norm()
    along = _dot(d, place).clamp(min=1e-6)
    return _dot(d, right) / along, _dot(d, torch.linalg.cross(right, place)) / along


def _box(x: Tensor, half: float, soft: float) -> Tensor:
    """1 where |x| is below `half`, 0 above, with a smooth rim that is `soft` wide."""
    return _step((half + soft / 2 - x.abs()) / soft)


def _step(x: Tensor) -> Tensor:
    """0 below 0, 1 above 1, smooth between: 3 x² - 2 x³."""
    x = x.clamp(0, 1)
    return x * x * (3 - 2 * x)


def _dot(d: Tensor, place: Tensor) -> Tensor:
    return torch.einsum("chw,c->hw", d, place)


def _colour(values: Colour) -> Tensor:
    return torch.tensor(values, dtype=torch.float64)[:, None, None]


def _mix(first: Colour, second: Colour, share: Tensor) -> Tensor:
    return _colour(first) + share * (_colour(second) - _colour(first))
