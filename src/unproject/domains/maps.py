"""Maps: surface materials, (N, 8, H, W), or (N, 10, H, W) of coloured specular albedo, as `ops.maps` packs them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeAlias

import numpy as np
import torch
from PIL import Image
from torch import Tensor

from .. import export
from ..data import Collection, Convention, procedural_probes
from ..data.readers.lights import KINDS, TELLING
from ..metrics import Finding, Score, material_scores, patch_distance
from ..ops.maps import MAPS, are_maps, pack_maps, specular_channels, unpack_maps, with_specular
from ..ops.microfacet import Reflection
from ..ops.shading import Sampling
from ..projections import Identity, Observation, Selection, Standardised
from ..projections.base import Projection
from ..projections.rendering import DIRECTED, Rendering
from .domain import Domain, Exporter
from .evidence import MIN_PICTURES, Evidence, match_finding

Fresnel: TypeAlias = Literal["eta", "albedo"]
LIGHTS = (("studio", 0.0), ("window", 0.7), ("sky", 1.4))
"""Built-in light, and the camera's angle from the normal in radians."""
LEGIBLE = 64
"""Pixels of a map in a preview at least, where its labels can be read."""
TEXEL_BYTES = 600
"""What a texel takes at most while a material is made at another size."""

MATCH = (4.0, 10.0)
"""Levels (doubtful, failed) of the patch distance over that of training pictures."""
CONSTANT, ALIKE = 1e-3, 0.5
"""Deviation of pictures below which all are alike, such as a specular map of 0.04, and how far others may be from them.
They are standardised by 0.001 (`standardised`): a map is good that is right to 0.008, two levels of 8 bits."""


@dataclass(frozen=True)
class Maps(Domain):
    """Maps of a material (N, 8 or 10, H, W): diffuse and specular albedo, roughness, normal; they have one pose.

    Args:
        fresnel: what the specular albedo means, see `ops.microfacet.Reflection`.

    Examples:
        >>> import unproject as up
        >>> sorted(up.Maps().arrays(up.data.wood(1, 16, 0)))
        ['diffuse', 'fresnel', 'normal', 'roughness', 'specular']
    """

    name: ClassVar[str] = "maps"
    previewed: ClassVar[int] = 10
    scored: ClassVar[int] = 500
    written: ClassVar[str] = "maps"
    fresnel: Fresnel = "albedo"

    def preview(self, x: Tensor, names: Sequence[str] | None = None) -> Image.Image:
        scale = math.ceil(LEGIBLE / x.shape[-1])
        return export.material_sheet(x, relit(x, self.fresnel), scale=scale, names=names)

    def arrays(self, x: Tensor) -> dict[str, np.ndarray]:
        named = {name: part.numpy() for name, part in unpack_maps(x).items()}
        return {**named, "fresnel": np.array(self.fresnel)}

    def samples(self, arrays: Mapping[str, np.ndarray]) -> Tensor:
        return pack_maps({name: torch.as_tensor(part) for name, part in arrays.items() if part.ndim == 4})

    def comparable(self, reference: Tensor, x: Tensor) -> Tensor:
        return with_specular(reference, specular_channels(x)) if are_maps(reference) else reference

    def scores(self, x: Tensor, reference: Tensor, seed: int = 0, turns: int | None = None) -> dict[str, Score]:
        return material_scores(x, reference, seed, rendered_alike(x, reference, self.fresnel))

    def projection_scores(
        self, y: Tensor, reference: Tensor, seed: int = 0, silhouettes: bool = False
    ) -> dict[str, Score]:
        found = patch_distance(y, reference, seed=seed)
        how = f"sliced Wasserstein-1 of patches, {len(y)} generated vs {len(reference)}"
        return {"patch": Score(found.mean, how, len(y), seed)}

    def picture_findings(self, seen: Evidence, seed: int = 0) -> list[Finding]:
        real, others = seen.real, seen.others[seen.apart.all(0)]
        if len(others) < MIN_PICTURES:  # nothing is held out, and all pictures there are were drawn: halves of them
            real, others = seen.real[::2], seen.real[1::2]
        if real.std() < CONSTANT:
            off = (seen.generated - real.mean((0, 2, 3), keepdim=True)).square().mean().sqrt().item()
            how = f"root mean square difference of generated pictures from real ones, which are all alike, over {ALIKE}"
            return [match_finding(off / ALIKE, how, len(seen.generated), MATCH, seed)]
        found, base = (patch_distance(y, real, seed=seed).mean for y in (seen.generated, others))
        how = f"patch distance of {len(seen.generated)} generated pictures, over that of training pictures {base:.4f}"
        return [match_finding(found / max(base, 1e-6), how, len(seen.generated), MATCH, seed)]

    def open_findings(self, observations: Sequence[Observation], seed: int = 0) -> list[Finding]:
        told = [told_by(observation.name, observation.projection) for observation in observations]
        left = [name for name in MAPS if not any(name in maps for maps in told)]
        if not left or any(not maps for maps in told):
            return []
        how = f"maps that the data tell: one is given, {', '.join(sorted(TELLING))} tell all, other light diffuse"
        says = f"nothing in the data tells the maps {', '.join(left)}, which are guesses"
        advice = "add photographs under a flash at the camera, or under coloured lamps: sub-folders flash, coloured"
        score = Score(len(MAPS) - len(left), how, len(MAPS), seed)
        return [Finding("open", score, len(MAPS) - 0.5, -math.inf, says, advice)]

    def bytes_at(self, size: int, n: int) -> int:
        """Return the bytes that n materials of another size take while they are made."""
        return (4 * 2 * n * 8 + TEXEL_BYTES) * size**2

    def read(self, path: Path, size: int) -> Collection:
        fresnel = "albedo" if self.fresnel == "albedo" else "stored"
        return Collection.materials(
            path, size, convention=Convention(specular="colour", fresnel=fresnel)
        ).warn_skipped()

    def options_of(self, exporter: Exporter, largest_part: bool, numbers: Sequence[int] | None) -> dict[str, Any]:
        how = getattr(exporter, "func", None)
        if numbers is None or how not in (*export.MATERIAL_FORMATS.values(), self.write_preview):
            return {}
        return {
            "names": [str(n) for n in numbers] if how == self.write_preview else export.names_of(numbers, "material-")
        }

    @property
    def exporters(self) -> Mapping[str, Exporter]:
        own = {name: partial(write, fresnel=self.fresnel) for name, write in export.MATERIAL_FORMATS.items()}
        return {**super().exporters, **own}


def told_by(name: str, projection: Projection) -> tuple[str, ...]:
    """Return the maps that images of an observation tell of, nothing if that is not known."""
    if isinstance(projection, Standardised):
        return told_by(name, projection.projection)
    if isinstance(projection, Selection):
        return (projection.map,)
    if isinstance(projection, Rendering):
        directed = isinstance(projection.lighting, str) and projection.lighting in DIRECTED
        return (*MAPS,) if (name in TELLING if name in KINDS else directed) else ("diffuse",)
    return (*MAPS,) if isinstance(projection, Identity) else ()


def rendered_alike(x: Tensor, reference: Tensor, fresnel: Fresnel = "albedo") -> dict[str, tuple[Tensor, Tensor]]:
    """Return both sets of maps under the same lights: the name of the light → a pair of renderings."""
    lit, expected = relit(x, fresnel), relit(reference, fresnel)
    return {light: (picture, expected[light]) for light, picture in lit.items()}


@torch.no_grad()
def relit(maps: Tensor, fresnel: Fresnel = "albedo") -> dict[str, Tensor]:
    """Render maps from above under a lamp ½ rad from the normal, and under `LIGHTS`: light → (N, 3, H, W)."""
    theta = torch.zeros(len(maps))
    pictures = {"lamp": under_a_lamp(maps, fresnel)}
    for rendering, (light, view) in zip(_renderings(fresnel), LIGHTS, strict=True):
        pictures[light] = rendering(maps, view=theta + view, light=theta, probe=theta, jitter=theta + 0.5)
    return pictures


@torch.no_grad()
def under_a_lamp(maps: Tensor, fresnel: Fresnel = "albedo") -> Tensor:
    """Render maps from above under a lamp ½ rad from the normal, at the upper left: (N, 3, H, W)."""
    theta = torch.zeros(len(maps))
    lamp = Rendering("directional", Reflection(fresnel))
    return lamp(maps, view=theta, light=theta + 0.5, light_azimuth=theta + 2.0)


@cache
def _renderings(fresnel: Fresnel) -> list[Rendering]:
    probes, names = procedural_probes(32)
    chosen = [probes[names.index(name)][None] for name, _ in LIGHTS]
    return [Rendering(probe, Reflection(fresnel), Sampling(64)) for probe in chosen]
