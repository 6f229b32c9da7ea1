"""Panels of materials: observations of maps and photographs, and where their images come from."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from .._random import derived_seed, generator_at
from .._types import UserError
from ..assignment import Panel
from ..data import (
    Collection,
    Convention,
    daylight_probes,
    material_patches,
    observe,
    photographed,
    procedural_probes,
    read_probes,
    refuse_unsorted,
    unsorted,
)
from ..data.readers.lights import FIRST
from ..data.readers.patches import side_to_cut_from
from ..ops.maps import MAPS, places, with_specular
from ..ops.microfacet import Reflection
from ..ops.shading import Sampling
from ..projections import Identity, Observation, Rendering, Selection, rendering_prior, standardised
from ..projections.rendering import Lighting
from ..training.memory import require_memory_to_train

Materials = Callable[..., Tensor]
"""(count, size, seed) → maps (count, 8, size, size) of a procedural data set, or 10 channels with `coloured=True`."""
Views = Literal["known", "direct"]
LIT: dict[str, Lighting] = {
    **dict.fromkeys(("flash", "lamp", "raking"), "directional"),
    **dict.fromkeys(("coloured", "overhead", "slanting"), "coloured"),
    "ambient": "ambient",
}
"""Photograph → its light, of those that are neither natural nor unknown."""
VIEWED_FROM = {"top": 0.0, "grazing": 80.0, **dict.fromkeys((*LIT, "daylight"), 0.0)}
"""Photograph → degrees of the camera from the normal."""
MIRRORED = {
    **dict.fromkeys((*MAPS, "flash", "lamp", "ambient", "daylight", "itself"), ((3,), (2,), (2, 3))),
    "raking": ((2,),),
    "top": ((2, 3),),
}
"""Axes along which the image of an observation may be flipped: the result is an image of the mirrored material. Natural
light has no mirror image, but may be turned by half a turn; daylight that nobody measured is as likely as its mirror
image; cameras are within 5° of the normal."""
LAMPS = {
    name: (math.radians(theta), math.pi)
    for name, theta in (("raking", 60), ("coloured", 60), ("slanting", 36), ("overhead", 12))
}
"""Angles of fixed lamps from the normal, and around it, in radians."""
NATURAL_LIGHT = {"top", "grazing"}
UNKNOWN_LIGHT = {*NATURAL_LIGHT, "daylight"}


class Weights(NamedTuple):
    """Weights of photographs in the generator's loss, under lamps and under natural light; and their penalty scale."""

    lamps: float = 1.0
    natural: float = 1.0
    penalty_scale: float = 1.0


class Light(NamedTuple):
    """Natural light (a folder, an .npz or one file; None: procedural probes) and Monte Carlo samples a pixel."""

    probes: Path | None
    samples: int


EQUAL = Weights()

Source = Callable[[Observation, int], Tensor]
"""(observation, count) → its images, each of another material."""


def source_of(procedural: Materials, data: Path | None, size: int, seed: int, coloured: bool = False) -> Source:
    """Return where images come from: a procedural data set, the materials of `data`, or folders of pictures.

    Args:
        procedural: makes the materials where there are no `data`.
        data: a path, or None.
        size: pixels a side.
        seed: of what is drawn.
        coloured: read three specular channels of `data`, else one; a procedural data set has what it has.
    """
    if data is not None and are_photographs(data):
        _warn_unsorted(data)

        def photographs(observation: Observation, count: int) -> Tensor:
            if observation.name == "itself":
                raise UserError(f"{data}: holds pictures of materials; direct training needs materials, or other views")
            found = Collection.photographs(data, observation.name, size, coloured=coloured)
            return _first(found.warn_skipped().floats(), count, seed)

        return photographs
    found = None if data is None else textures_of(data, size, coloured)

    def images(observation: Observation, count: int) -> Tensor:
        own = derived_seed(seed, 0, f"materials/{observation.name}")
        if found is None:
            made = f"making {count} materials takes"
            require_memory_to_train(64 * count * size**2, made, "lower --size or --maps, or give --data")
            x = procedural(count, size, own)
        elif found.shape[-2:] == (size, size):
            x = _first(found, count, own)
        else:
            x = material_patches(found, count, size, own)
        return observe(x, [observation], seed=own).floats()

    return images


def _warn_unsorted(data: Path) -> None:
    """Warn of pictures that no observation is made of."""
    found = unsorted(data)
    if found:
        file, reason = next(iter(found.items()))
        warnings.warn(
            f"{data}: pictures that are not used: {len(found)}, the first: {file.name}: {reason}", stacklevel=2
        )


def textures_of(data: Path, size: int, coloured: bool = False) -> Tensor:
    """Return the maps of `data`: an .npz in its size, texture sets larger than the patches that are cut out of them.

    Raises:
        UserError: for photographs that say nothing of their light, or if there is no material.
    """
    refuse_unsorted(data)
    side = None if data.suffix.lower() == ".npz" else side_to_cut_from(size)
    how = Convention(specular="colour" if coloured else "luminance", fresnel="albedo")
    found = Collection.materials(data, side, convention=how).warn_skipped().floats()
    return with_specular(found, 3 if coloured else 1)


def are_photographs(data: Path | None) -> bool:
    """Whether a folder has sub-folders of pictures, one an observation."""
    return data is not None and bool(photographed(data))


def with_mirror_images(source: Source) -> Source:
    """Return the same images and all their mirror images that light and camera allow (`MIRRORED`)."""

    def images(observation: Observation, count: int) -> Tensor:
        found, name = source(observation, count), observation.name
        return torch.cat([found, *(mirrored(name, found, axes) for axes in MIRRORED.get(name, ()))])

    return images


def mirrored(observation: str, images: Tensor, axes: tuple[int, ...]) -> Tensor:
    """Flip images along rows (2), columns (3) or both; x and y of normals change sign."""
    flipped = images.flip(axes)
    if observation in ("normal", "itself"):
        first = 0 if observation == "normal" else places(images.shape[1])["normal"].start
        for axis, channel in ((3, first), (2, first + 1)):
            if axis in axes:
                flipped[:, channel] *= -1
    return flipped


def observations_of(data: str | Path | None) -> tuple[str, ...]:
    """Return the observations that `data` has sub-folders for; else the maps and what determines them (`FIRST`)."""
    found = () if data is None else photographed(Path(data))
    return found or (*MAPS, *FIRST)


def panels_of(
    source: Source,
    views: Views,
    names: Sequence[str],
    counts: tuple[int, int],
    light: Light,
    weights: Weights = EQUAL,
) -> list[Panel]:
    """Return a panel for each observation; or one of the materials themselves, with as many images in all.

    Args:
        counts: images of each map, and of each kind of photograph.
    """
    if min(counts) < 0:
        raise UserError(f"{min(counts)} images of a kind: give 0 or more")
    count_of = dict.fromkeys(MAPS, counts[0]) | dict.fromkeys(VIEWED_FROM, counts[1])
    chosen = [name for name in dict.fromkeys(names) if count_of.get(name, 1)]
    natural = natural_light(chosen, light.probes)
    observations = [observation_of(name, natural, light.samples) for name in chosen]
    if not observations:
        raise UserError("observations: name at least one, with at least one sample")
    if views == "direct":
        itself = Observation("itself", Identity())
        return [standardised_panel(itself, source(itself, max(1, sum(map(count_of.__getitem__, chosen)) // len(MAPS))))]
    return [standardised_panel(o, source(o, count_of[o.name]), weights) for o in observations]


def _first(items: Tensor, count: int, seed: int) -> Tensor:
    """Return `count` items, or all there are, in a random order."""
    return items[torch.randperm(len(items), generator=generator_at(seed, 0, "order"))[:count]]


def natural_light(names: Sequence[str], probes: Path | None, height: int = 32) -> Tensor | None:
    """Return environments (K, 3, height, 2 height): those of a path, or procedural ones; None if none is needed."""
    if not NATURAL_LIGHT & set(names):
        if probes is not None:
            warnings.warn(
                f"probes {probes}: not read, as no observation is lit by them; see observations", stacklevel=2
            )
        return None
    return procedural_probes(height)[0] if probes is None else read_probes(probes, height)[0]


def observation_of(name: str, natural: Tensor | None, samples: int) -> Observation:
    """Return the observation of this name.

    Raises:
        UserError: for an unknown name.
    """
    if name in ("diffuse", "specular", "roughness", "normal"):
        return Observation(name, Selection(name))
    if name not in VIEWED_FROM:
        raise UserError(f"observations: there is none called {name!r}; choose from {', '.join((*MAPS, *VIEWED_FROM))}")
    lighting = daylight_probes() if name == "daylight" else LIT.get(name, natural)
    assert lighting is not None
    metered = "surface" if name == "daylight" else None
    rendering = Rendering(lighting, Reflection("albedo"), Sampling(samples), metered=metered)
    light, azimuth = ({"flash": (0.0, None)} | LAMPS).get(name, (None, None))
    return Observation(
        name, rendering, rendering_prior(rendering, math.radians(VIEWED_FROM[name]), light, light_azimuth=azimuth)
    )


def standardised_panel(observation: Observation, images: Tensor, weights: Weights = EQUAL) -> Panel:
    """Return an observation's panel, its images and projections standardised by the images' mean and deviation."""
    name = observation.name
    projection = standardised(observation.projection, images)
    data = Collection(projection.standardise(images), source=f"{len(images)} images of {name}")
    observed = [Observation(name, projection, observation.prior)]
    if name not in VIEWED_FROM:
        return Panel(observed, data)
    weight = weights.natural if name in UNKNOWN_LIGHT else weights.lamps
    return Panel(observed, data, weight=weight, penalty_scale=weights.penalty_scale)
