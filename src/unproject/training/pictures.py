"""What a generator makes right now, as one picture."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import torch
from torch import Tensor

from ..data import procedural_probes
from ..export import contact_sheet, material_sheet, silhouette_sheet
from ..networks import Generator
from ..ops.maps import kind_of
from ..ops.microfacet import Reflection
from ..ops.shading import Sampling
from ..projections.rendering import Rendering

SHAPES, IMAGES, MATERIALS = 6, 64, 10
LIGHTS = (("studio", 0.0), ("window", 0.7), ("sky", 1.4))  # and the camera's angle from the normal


def save_samples(generator: Generator, path: Path) -> None:
    """Things of the same codes at every call, so that pictures of a run can be compared."""
    save_picture(lambda n: generator.sample(n, seed=0), path)


def save_picture(things: Callable[[int], Tensor], path: Path) -> None:
    """A sheet of so many things, the first of what `things` gives, as it suits their kind."""
    x = things(SHAPES)
    kind = kind_of(x)
    if kind == "image":
        silhouette_sheet(things(IMAGES), path, scale=2)
    elif kind == "maps":
        maps = things(MATERIALS)
        material_sheet(maps, relit(maps), path)
    else:
        contact_sheet(x, path, size=96)


@torch.no_grad()
def relit(maps: Tensor) -> list[Tensor]:
    """Maps from above under a lamp ½ rad from the normal, and under the built-in lights: (N, 3, H, W), one a light."""
    theta = torch.zeros(len(maps))
    lamp = Rendering("directional", Reflection("albedo"))
    pictures = [lamp(maps, view=theta, light=theta + 0.5, light_azimuth=theta + 2.0)]
    for look, (_, view) in zip(_looks(), LIGHTS, strict=True):
        pictures.append(look(maps, view=theta + view, light=theta, probe=theta, jitter=theta + 0.5))
    return pictures


@cache
def _looks() -> list[Rendering]:
    probes, names = procedural_probes(32)
    chosen = [probes[names.index(name)][None] for name, _ in LIGHTS]
    return [Rendering(probe, Reflection("albedo"), Sampling(64)) for probe in chosen]
