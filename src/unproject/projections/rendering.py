"""Pictures of a flat material: a camera aimed at its centre, under ambient, directional or natural light."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Literal

import torch
from torch import Tensor

from .._types import UserError
from ..ops.environment import Environments, exposure, prepare_environments
from ..ops.exposure import develop
from ..ops.maps import CHANNELS
from ..ops.microfacet import Reflection
from ..ops.plane import photograph, to_camera, towards
from ..ops.shading import Ambient, Directional, Environment, Light, Sampling
from ..ops.shading_native import shade_fast
from .base import Projection
from .observation import Observation
from .priors import Cap, Prior, Product, Uniform
from .selection import as_maps

FRONT = -math.pi / 2  # the camera stands at the picture's bottom edge
SPREAD = math.radians(5)
DIRECTED = ("directional", "coloured")
THIRD = 2 * math.pi / 3


@dataclass(frozen=True, eq=False)
class Rendering(Projection):
    """y = the picture of maps (B, 8, H, W), or of maps by name, as (B, 3, H, W).

    The material is one unit wide and lies in z = 0 (docs/conventions.md). Its latents, all (B,), angles in radians:
    `view`, the camera's polar angle from the normal, and `view_azimuth` (-90°, from the bottom edge, unless given);
    of directional light `light`, its polar angle, and `light_azimuth`; of natural light `light`, by which it is turned
    about the normal, and `probe`, whose whole part says which; and where samples are drawn `jitter` in [0, 1), which
    ones: the same number gives the same picture.

    Attributes:
        lighting: "ambient", radiance 1 from everywhere; "directional", irradiance π on a plane that faces it;
            "coloured", three of these, a red one where `light_azimuth` says, a green one 120° and a blue one 240° on:
            shading, which differs between the colours, is told from albedo, and one photograph shows the relief; or
            environments (K, 3, H, W), lat-long, the top row at the normal.
        reflection: how specular albedos are meant (`ops.microfacet.Reflection`).
        sampling: how many samples, which and which gradient (`ops.shading.Sampling`).
        distance: of the camera from the centre, in widths of the material.
        space: "texture": each texel at its own place, as it looks from the camera; "image": the perspective picture.
        repeat: "image" only: the material again beside itself, else black.
        developed: exposed to the light of the upper hemisphere, gamma 2.2, clamped at 1, as a photograph is; else
            linear radiance.

    Raises:
        UserError: for settings or maps that cannot be, or a latent too many or too few.
    """

    lighting: str | Tensor = "ambient"
    reflection: Reflection = Reflection()
    sampling: Sampling = Sampling()
    distance: float = 4.0
    space: Literal["texture", "image"] = "texture"
    repeat: bool = False
    developed: bool = True
    environments: Environments | None = field(init=False, default=None, repr=False)
    example_shape: ClassVar[tuple[int, ...]] = (CHANNELS, 4, 4)

    def __post_init__(self) -> None:
        if isinstance(self.lighting, str):
            if self.lighting not in ("ambient", *DIRECTED):
                raise UserError(
                    f"Rendering(lighting={self.lighting!r}): give 'ambient', 'directional', 'coloured' or environments "
                    "(K, 3, H, W)"
                )
        elif not isinstance(self.lighting, Tensor) or not self.lighting.is_floating_point():
            raise UserError("Rendering: environments are a float tensor (K, 3, H, W), linear radiance")
        else:
            lit = self.lighting
            if self.developed and lit.dim() == 4:
                lit = lit * exposure(lit)[:, None, None, None]
            object.__setattr__(self, "environments", prepare_environments(lit))
        if not self.distance > 0.5:
            raise UserError(f"Rendering(distance={self.distance:g}): give more than half a width, 4 for a photograph")
        if self.space not in ("texture", "image"):
            raise UserError(f"Rendering(space={self.space!r}): give 'texture' or 'image'")

    @property
    def latents(self) -> tuple[str, ...]:
        if self.environments is not None:
            return ("view", "view_azimuth", "light", "probe", "jitter")
        return (
            "view",
            "view_azimuth",
            *(("light", "light_azimuth") if self.lighting in DIRECTED else ("jitter",)),
        )

    def forward(  # pyright: ignore[reportIncompatibleMethodOverride]
        self,
        x: Tensor | Mapping[str, Tensor],
        *,
        view: Tensor,
        view_azimuth: Tensor | None = None,
        light: Tensor | None = None,
        light_azimuth: Tensor | None = None,
        probe: Tensor | None = None,
        jitter: Tensor | None = None,
    ) -> Tensor:
        x = as_maps(x)
        if x.dim() != 4 or x.shape[1] != CHANNELS:
            raise UserError(f"Rendering: give maps (B, {CHANNELS}, H, W), not {tuple(x.shape)}")
        given = {"light": light, "light_azimuth": light_azimuth, "probe": probe, "jitter": jitter}
        for name, value in {"view": view, "view_azimuth": view_azimuth, **given}.items():
            if value is not None and (not isinstance(value, Tensor) or value.shape != x.shape[:1]):
                shape = tuple(value.shape) if isinstance(value, Tensor) else value
                raise UserError(f"Rendering: give one {name} a material, a tensor ({len(x)},), not {shape}")
        wrong = [name for name, value in given.items() if value is not None and name not in self.latents]
        if wrong:
            raise UserError(f"Rendering: this light takes no {wrong[0]}; its latents are {', '.join(self.latents)}")
        with torch.autocast(x.device.type, enabled=False):
            x = x if x.dtype == torch.float64 else x.float()
            nothing = x.new_zeros(len(x))
            if light is not None:  # many turns would cost it its digits
                light = light - 2 * math.pi * (light.detach() / (2 * math.pi)).round()
            rest = [nothing if value is None else value.to(x) for value in (light, light_azimuth, probe, jitter)]
            azimuth = torch.full_like(nothing, FRONT) if view_azimuth is None else view_azimuth.to(x)
            return self._look(x, view.to(x), azimuth, *rest)

    def _look(
        self, x: Tensor, view: Tensor, azimuth: Tensor, light: Tensor, around: Tensor, probe: Tensor, jitter: Tensor
    ) -> Tensor:
        camera = to_camera(view, azimuth, self.distance, *x.shape[2:])
        turns = (0.0, THIRD, 2 * THIRD) if self.lighting == "coloured" else (0.0,)
        lights = [self._light(light, around + turn, probe) for turn in turns]
        seen = [shade_fast(x, camera, one, self.reflection, self.sampling, jitter) for one in lights]
        radiance = torch.stack([y[:, k] for k, y in enumerate(seen)], 1) if len(seen) == 3 else seen[0]
        if self.space == "image":
            radiance = photograph(radiance, view, azimuth, self.distance, self.repeat)
        return develop(radiance) if self.developed else radiance

    def _light(self, light: Tensor, around: Tensor, probe: Tensor) -> Light:
        if self.environments is not None:
            table, running = (part.to(light) for part in self.environments)
            return Environment(Environments(table, running), probe.long().clamp(0, len(table) - 1), light)
        return Directional(towards(light, around)) if self.lighting in DIRECTED else Ambient()


def rendering_prior(
    rendering: Rendering,
    view: float,
    light: float | None = None,
    spread: float = SPREAD,
    light_azimuth: float | None = None,
) -> Prior:
    """Views within `spread` of `view` from the picture's bottom edge, and the light drawn as it comes.

    Natural light is any of the environments turned at random; directional light comes from within `light` radians of
    the normal, evenly over the sphere: 0 is normal incidence, None the hemisphere down to 80°. With `light_azimuth` it
    stands there, within `spread` of `light` from the normal and of that azimuth; with three lamps, the red one.

    Raises:
        UserError: for `light` where no lamp is, or `light_azimuth` without `light`.
    """
    if light is not None and rendering.lighting not in DIRECTED:
        raise UserError("rendering_prior(light=...): is for directional and coloured light; leave it out")
    if light_azimuth is not None and light is None:
        raise UserError("rendering_prior(light_azimuth=...): give light, the angle from the normal, too")
    factors: list[Prior] = [Uniform("view", view - spread, view + spread), Uniform("view_azimuth", FRONT, FRONT)]
    if rendering.environments is not None:
        count = len(rendering.environments.table)
        factors += [Uniform("light", 0, 2 * math.pi), Uniform("probe", 0, count), Uniform("jitter", 0, 1)]
    elif light is not None and light_azimuth is not None:
        factors += [
            Uniform(name, angle - spread, angle + spread)
            for name, angle in (("light", light), ("light_azimuth", light_azimuth))
        ]
    elif rendering.lighting in DIRECTED:
        factors.append(Cap("light", "light_azimuth", math.radians(80) if light is None else light))
    else:
        factors.append(Uniform("jitter", 0, 1))
    return Product(*factors)


def photographs(
    lighting: str | Tensor, reflection: Reflection | None = None, sampling: Sampling | None = None
) -> tuple[Observation, Observation]:
    """The paper's two: `top`, from 0 ± 5° of the normal, and `grazing`, from 80 ± 5°."""
    look = Rendering(lighting, reflection or Reflection(), sampling or Sampling())
    return (
        Observation("top", look, rendering_prior(look, 0)),
        Observation("grazing", look, rendering_prior(look, math.radians(80))),
    )
