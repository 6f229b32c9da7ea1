"""Lighting: a material as a tile, as a plane of 2 × 2 tiles, or around a ball, by `ops.shading`.

The plane is what `up.Rendering` photographs. The ball has the material four times around its axis, z, and twice along
it; each pixel has a frame of its own, tangents along longitude and latitude, in which its normal is that of the map:

    n = n_x T + n_y B + n_z N,   T = (-sin λ, cos λ, 0),   B = N × T,   N = (cos φ cos λ, cos φ sin λ, sin φ).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import torch
import torch.nn.functional as F
from torch import Tensor

from ..ops.environment import Environments, exposure, prepare_environments
from ..ops.exposure import develop
from ..ops.lights import Ambient, Directional, Environment, Light, coloured_lamps
from ..ops.maps import places
from ..ops.microfacet import Reflection
from ..ops.plane import photograph, to_camera, towards
from ..ops.shading import Sampling
from ..ops.shading_native import shade_fast

SIDE, AROUND, DISTANCE = 256, 4, 4.0
"""Pixels of a picture, tiles around the ball, and how far the camera is, in widths of the plane."""
PAPER = 0.98
"""What is behind the material, after the gamma."""
Form = Literal["tile", "plane", "ball"]


@dataclass(frozen=True)
class Scene:
    """How a material is seen. Angles in radians, as in docs/conventions.md.

    Attributes:
        form: what has the material.
        view, around: of the camera, from z and about it.
        light: "ambient", "directional", "coloured", or an environment that `exposed` has prepared.
        polar, turn: of the light from z, and about it.
        samples: for natural and ambient light.
    """

    form: Form
    view: float
    around: float
    light: str | Environments
    polar: float
    turn: float
    samples: int


def exposed(radiance: Tensor) -> Environments:
    """Return an environment (3, H, W), lat-long, as a camera is exposed to it."""
    radiance = radiance[None].float()
    return prepare_environments(radiance * exposure(radiance)[:, None, None, None])


@torch.no_grad()
def picture_of_scene(maps: Tensor, scene: Scene, reflection: Reflection) -> Tensor:
    """Return the picture (3, 256, 256) in [0, 1] of a material (8 or 10, H, W)."""
    if scene.form == "ball":
        return _ball(maps, scene, reflection)
    times = 2 if scene.form == "plane" else 1
    tiled = F.pad(maps[None].repeat(1, 1, times, times), (1, 1, 1, 1), mode="circular")
    x = _resampled(tiled, SIDE, SIDE * tiled.shape[2] // tiled.shape[3])
    view, around = torch.tensor([scene.view]), torch.tensor([scene.around])
    seen = _shaded(x, to_camera(view, around, DISTANCE, *x.shape[2:]), scene, reflection)
    covered = torch.cat([seen, torch.ones_like(seen[:, :1])], 1)
    pictured = photograph(covered, view, around, DISTANCE)
    return (develop(pictured[:, :3]) + PAPER * (1 - pictured[:, 3:]))[0].clamp(max=1)


def _resampled(tiled: Tensor, width: int, height: int) -> Tensor:
    """Return maps with a border of one texel, finer and without it."""
    rows = torch.linspace(-1, 1, 2 * height + 1)[1::2] * (1 - 2 / tiled.shape[2])
    columns = torch.linspace(-1, 1, 2 * width + 1)[1::2] * (1 - 2 / tiled.shape[3])
    grid = torch.stack([columns.expand(height, width), rows[:, None].expand(height, width)], -1)[None]
    return F.grid_sample(tiled, grid, align_corners=False)


def _shaded(x: Tensor, camera: Tensor, scene: Scene, reflection: Reflection) -> Tensor:
    return shade_fast(x, camera, _light(scene), reflection, Sampling(scene.samples), torch.zeros(1))


def _light(scene: Scene) -> Light:
    if isinstance(scene.light, Environments):
        return Environment(scene.light, torch.zeros(1, dtype=torch.long), torch.tensor([scene.turn]))
    if scene.light == "ambient":
        return Ambient()
    where = torch.tensor([scene.polar]), torch.tensor([scene.turn])
    return coloured_lamps(*where) if scene.light == "coloured" else Directional(towards(*where))


def _ball(maps: Tensor, scene: Scene, reflection: Reflection) -> Tensor:
    across = (2 * torch.arange(SIDE) + 1 - SIDE) / (SIDE - 8)  # a margin of four pixels
    right, up = across.expand(SIDE, SIDE), -across[:, None].expand(SIDE, SIDE)
    radius = torch.hypot(right, up)
    inner = (1 - radius.square()).clamp(min=1e-4).sqrt()
    view, around = torch.tensor(scene.view), torch.tensor(scene.around)
    back = towards(view, around)
    sideways = torch.stack([-around.sin(), around.cos(), torch.zeros(())])
    axes = torch.stack([sideways, torch.linalg.cross(back, sideways), back])
    normal = F.normalize(torch.stack([right, up, inner], -1) @ axes, dim=-1)
    x = _wrapped(maps, normal)
    camera = back.view(1, 3, 1, 1).expand(1, 3, SIDE, SIDE).contiguous()
    seen = develop(_shaded(x, camera, scene, reflection))[0]
    cover = ((1 - radius) * SIDE / 2 + 0.5).clamp(0, 1)
    return seen * cover + PAPER * (1 - cover)


def _wrapped(maps: Tensor, normal: Tensor) -> Tensor:
    """Return the maps (1, 8 or 10, H, W) of the points of a ball that have these normals (H, W, 3)."""
    longitude, latitude = torch.atan2(normal[..., 1], normal[..., 0]), torch.asin(normal[..., 2].clamp(-1, 1))
    height, width = maps.shape[1:]
    u, v = longitude * (AROUND / (2 * math.pi)), -latitude * (AROUND / (2 * math.pi)) * (width / height)
    padded = F.pad(maps[None], (1, 1, 1, 1), mode="circular")
    inner = torch.tensor([width / (width + 2), height / (height + 2)])
    grid = (2 * (torch.stack([u, v], -1) % 1.0) - 1) * inner
    x = F.grid_sample(padded, grid[None], align_corners=False)
    tangent = torch.stack([-longitude.sin(), longitude.cos(), torch.zeros_like(longitude)], -1)
    frame = torch.stack([tangent, torch.linalg.cross(normal, tangent), normal], -1)
    place = places(len(maps))["normal"]
    own = x[0, place].movedim(0, -1)
    # Straight down the frame of a normal has no tangents (`ops.shading.frame_of`).
    turned = F.normalize((frame @ own[..., None])[..., 0] + torch.tensor([0.0, 0.0, 1e-5]), dim=-1)
    return torch.cat([x[:, : place.start], turned.movedim(-1, 0)[None]], 1)
