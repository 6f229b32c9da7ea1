"""Renderings of a flat material by a camera aimed at its centre, under ambient, directional or natural light."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import ClassVar, Literal, TypeAlias

import torch
from torch import Tensor

from .._types import UserError
from ..ops.environment import Environments, exposure, prepare_environments, surface_exposure
from ..ops.exposure import develop
from ..ops.lights import Ambient, Directional, Environment, Light, coloured_lamps
from ..ops.maps import CHANNELS, unpack_maps
from ..ops.microfacet import Reflection
from ..ops.plane import photograph, to_camera, towards
from ..ops.shading import Sampling
from ..ops.shading_native import shade_fast
from .base import Projection
from .priors import Cap, Prior, Product, Uniform
from .selection import as_maps

Lighting: TypeAlias = Literal["ambient", "directional", "coloured"]
FRONT = -math.pi / 2  # the camera stands at the picture's bottom edge
SPREAD = math.radians(5)
DIRECTED = ("directional", "coloured")


@dataclass(frozen=True, eq=False)
class Rendering(Projection):
    """y = the rendering (B, 3, H, W) of a material, maps (B, 8, H, W) or maps by name.

    Of maps (B, 10, H, W), with a coloured specular albedo, each colour of y is shaded with its own, which takes three
    times as long (under coloured lamps no longer).

    The material is one unit wide and lies in z = 0 (docs/conventions.md). Latents, all (B,), angles in radians:

    ================ ==================== =================================================================
    latent           lighting             meaning
    ================ ==================== =================================================================
    `view`           all                  polar angle of the camera from the normal
    `view_azimuth`   all                  azimuth of the camera (default: -90°, from the bottom edge)
    `light`          directional          polar angle of the light from the normal
    `light_azimuth`  directional          azimuth of the light
    `light`          environments         rotation of the environment about the normal
    `probe`          environments         its integer part is the index of the environment
    `jitter`         ambient, environm.   seed of the sample points, in [0, 1); equal numbers give equal renderings
    ================ ==================== =================================================================

    Attributes:
        lighting: "ambient", radiance 1 from everywhere; "directional", irradiance π on a plane that faces it;
            "coloured", three directional lights, red at `light_azimuth`, green 120° and blue 240° further, so that one
            image separates shading from albedo and shows the relief; or environments (K, 3, H, W), lat-long, the top
            row at the normal.
        reflection: the reflection model (`ops.microfacet.Reflection`).
        sampling: number and kind of samples, and the estimator of the gradient (`ops.shading.Sampling`).
        distance: of the camera from the centre, in widths of the material.
        space: "texture", each texel shaded at its own place in the grid of the maps, or "image", in perspective.
        repeat: in "image" space, tile the plane with the material (default: black outside it).
        developed: expose to the light of the upper hemisphere, apply gamma 2.2 and clamp at 1, as a photograph; else
            linear radiance.
        metered: what environments are exposed to: all light from above (default, the paper's auto-exposure), or
            "surface", the light on a flat surface, as by a camera that sees nothing else.

    Raises:
        UserError: for invalid settings or maps, or a missing or unexpected latent.

    Examples:
        >>> import torch, unproject as up
        >>> diffuse, normal = torch.ones(1, 3, 4, 4), torch.tensor([0.0, 0, 1]).view(1, 3, 1, 1).expand(1, 3, 4, 4)
        >>> maps = torch.cat([diffuse, torch.zeros(1, 1, 4, 4), torch.full((1, 1, 4, 4), 0.3), normal], 1)
        >>> lamp = up.Rendering("directional", up.ops.microfacet.Reflection("albedo"), developed=False)
        >>> zero = torch.zeros(1)
        >>> lamp(maps, view=zero, light=zero, light_azimuth=zero)[0, :, 0, 0]  # white, facing the light: radiance 1
        tensor([1., 1., 1.])
    """

    replayable: ClassVar[bool] = True
    lighting: Lighting | Tensor = "ambient"
    reflection: Reflection = Reflection()
    sampling: Sampling = Sampling()
    distance: float = 4.0
    space: Literal["texture", "image"] = "texture"
    repeat: bool = False
    developed: bool = True
    metered: Literal["surface"] | None = field(default=None, metadata={"described": "if given"})
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
                factor = surface_exposure(lit) if self.metered else exposure(lit)
                lit = lit * factor[:, None, None, None]
            object.__setattr__(self, "environments", prepare_environments(lit))
        if self.metered not in (None, "surface"):
            raise UserError(f"Rendering(metered={self.metered!r}): give 'surface' or None")
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

    def forward(
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
        unpack_maps(x)
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
            if light is not None:  # float32 loses digits at angles of many turns
                light = light - 2 * math.pi * (light.detach() / (2 * math.pi)).round()
            rest = [nothing if value is None else value.to(x) for value in (light, light_azimuth, probe, jitter)]
            azimuth = torch.full_like(nothing, FRONT) if view_azimuth is None else view_azimuth.to(x)
            return self._render(x, view.to(x), azimuth, *rest)

    def _render(
        self, x: Tensor, view: Tensor, azimuth: Tensor, light: Tensor, around: Tensor, probe: Tensor, jitter: Tensor
    ) -> Tensor:
        def shaded(x: Tensor, camera: Tensor, row: int | None = None) -> Tensor:
            rows = slice(None) if row is None else slice(row, row + 1)
            lit = self._light(light[rows], around[rows], probe[rows])
            return shade_fast(x, camera, lit, self.reflection, self.sampling, jitter[rows])

        if self.space == "image" and self.repeat:
            radiance = photograph(x, view, azimuth, self.distance, True, shaded)
        else:
            radiance = shaded(x, to_camera(view, azimuth, self.distance, *x.shape[2:]))
        if self.space == "image" and not self.repeat:
            radiance = photograph(radiance, view, azimuth, self.distance)
        return develop(radiance) if self.developed else radiance

    def _light(self, light: Tensor, around: Tensor, probe: Tensor) -> Light:
        if self.environments is not None:
            table, running = _placed(self.environments, light.device, light.dtype)
            return Environment(Environments(table, running), probe.long().clamp(0, len(table) - 1), light)
        if self.lighting == "coloured":
            return coloured_lamps(light, around)
        return Directional(towards(light, around)) if self.lighting == "directional" else Ambient()


@lru_cache(maxsize=32)
def _placed(environments: Environments, device: torch.device, dtype: torch.dtype) -> Environments:
    """Return environments on a device: they are megabytes, and needed in every step."""
    return Environments(*(part.to(device, dtype) for part in environments))


def rendering_prior(
    rendering: Rendering,
    view: float,
    light: float | None = None,
    spread: float = SPREAD,
    light_azimuth: float | None = None,
) -> Prior:
    """Return a prior over the latents of a rendering: views from the bottom edge of the picture, and the light.

    Natural light is one of the environments in a random rotation. Directional light is uniform by solid angle within
    `light` of the normal, or, with `light_azimuth`, uniform within `spread` of these two angles. All in radians.

    Args:
        rendering: whose latents are drawn.
        view: polar angle of the camera; the prior is uniform within `spread` of it.
        light: largest polar angle of directional light, 0 for normal incidence (default: 80°); with `light_azimuth`,
            the polar angle itself.
        spread: half the range of angles (default: 5°).
        light_azimuth: azimuth of directional light; of the red one of three coloured lights.

    Raises:
        UserError: for `light` without directional light, or `light_azimuth` without `light`.

    Examples:
        >>> import unproject as up
        >>> from unproject.projections import rendering_prior
        >>> lamp = up.Rendering("directional")
        >>> up.Observation("top", lamp, rendering_prior(lamp, view=0)).prior.names
        ('view', 'view_azimuth', 'light', 'light_azimuth')
    """
    if light is not None and rendering.lighting not in DIRECTED:
        raise UserError("rendering_prior(light=...): only directional and coloured lighting take it; leave it out")
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
