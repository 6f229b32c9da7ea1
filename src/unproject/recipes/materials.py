"""Surface materials from maps and photographs of them: the recipes of the paper's Part II, and modern ones.

Each observation is a panel: it has a collection of its own, whose images show materials drawn independently, and a
discriminator of its own. Which are used, and how many images of each, is the experiment:

============ =====================================================================================
observation  image
============ =====================================================================================
diffuse …    one map as it is (`Selection`): diffuse, specular, roughness, normal
top          a photograph from 0 ± 5° of the normal under natural light
grazing      a photograph from 80 ± 5° under natural light
flash        from the top, directional light at normal incidence
lamp         from the top, directional light from anywhere above
raking       from the top, directional light from the left, 60 ± 5° from the normal
coloured     from the top, three lamps 60 ± 5° from the normal: red at the left, green below right, blue above right
ambient      from the top, constant light
============ =====================================================================================
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Sequence
from functools import partial, wraps
from pathlib import Path
from typing import Any, Literal, NamedTuple

import torch
from torch import Tensor
from typing_extensions import Unpack

from .._random import derived_seed, generator_at
from .._types import UserError
from ..adversarial.losses import Logistic, Relativistic
from ..adversarial.penalties import R1R2
from ..assignment import Panel
from ..data import (
    Collection,
    correlated,
    material_patches,
    metal,
    observe,
    photographed,
    plastic,
    procedural_probes,
    read_probes,
    wood,
)
from ..networks import DCGANDiscriminator, DCGANMaterials, StationaryMaterials, TextureDiscriminator
from ..ops.maps import MAPS
from ..ops.microfacet import Reflection
from ..ops.shading import Sampling
from ..projections.base import Identity
from ..projections.observation import Observation
from ..projections.rendering import Rendering, rendering_prior
from ..projections.selection import Selection
from ..projections.standardised import SCALE, standardised
from ..training import Adam, Options, Recipe, resumable
from ..training.estimate import require_memory

Materials = Callable[[int, int, int], Tensor]
"""(count, size, seed) → maps (count, 8, size, size) of a procedural data set."""
Views = Literal["known", "direct"]
VIEWED_FROM = {"top": 0.0, "grazing": 80.0, "flash": 0.0, "lamp": 0.0, "raking": 0.0, "coloured": 0.0, "ambient": 0.0}
MIRRORED = {
    **dict.fromkeys((*MAPS, "flash", "lamp", "ambient", "itself"), ((3,), (2,), (2, 3))),
    "raking": ((2,),),
    "top": ((2, 3),),
}
"""Axes along which the image of an observation may be flipped: the result is an image of the mirrored material. Natural
light has no mirror image, but may be turned by half a turn; cameras are within 5° of the normal."""
LAMPS = {"raking": (math.radians(60), math.pi), "coloured": (math.radians(60), math.pi)}
"""Angles of fixed lamps from the normal, and around it, in radians."""
PENALTY_SCALE = 20.0
UNKNOWN_LIGHT = {"top", "grazing"}
NATURAL_LIGHT_WEIGHT = 0.5
ENLARGED = 4  # texture sets are read at so many times the size of the patches that are cut out of them


def materials(
    procedural: Materials,
    *,
    data: Path | None = None,
    views: Views = "known",
    observations: tuple[str, ...] | None = None,
    maps: int = 500,
    renderings: int = 250,
    probes: Path | None = None,
    size: int = 64,
    samples: int = 8,
    seed: int = 0,
    channels: int = 128,
    discriminator_channels: int = 16,
    rate: float = 1.5e-3,
    gamma: float = 0.5,
    photograph_weight: float = 3.0,
    natural_light_weight: float = NATURAL_LIGHT_WEIGHT,
    penalty_scale: float = PENALTY_SCALE,
    flips: bool = False,
    **options: Unpack[Options],
) -> Recipe:
    """Materials from any mix of maps and photographs, for a laptop.

    Args:
        procedural: makes the materials where there are no `data`.
        data: a folder with a sub-folder of pictures for each observation; or texture sets, or an .npz of maps, of which
            patches are observed (default: a procedural data set).
        views: known (a discriminator for each observation) or direct (one of all maps jointly, with as many images in
            all).
        observations: which to use, by name (default: those that `data` has sub-folders for; else the four maps, flash,
            coloured and ambient).
        maps: samples of each map, at most as many as `data` has.
        renderings: pictures of each kind of photograph, at most as many as `data` has.
        probes: natural light: a folder, an .npz or one file (default: five procedural probes).
        size: pixels a side.
        samples: Monte Carlo samples a pixel, where light is not directional.
        seed: of the weights, of every draw, and of the collections.
        channels: of the generator's 4² level.
        discriminator_channels: of the discriminators' first level.
        rate: learning rate at the start; it falls to a tenth along a cosine.
        gamma: weight of R1 and R2, in units of images brought to one deviation.
        photograph_weight: weight of photographs in the loss of the generator, where a map has 1; photographs determine
            how maps are correlated.
        natural_light_weight: the same for photographs of `data` under natural light, which is unknown: effects of light
            should not be painted into the maps.
        penalty_scale: factor of gamma for photographs, of which a few hundred would otherwise be memorised.
        flips: learn from mirror images too, of maps and of those photographs whose light allows it.
        options: fields of `Recipe`.
    """
    options = {"batch": 8, "checkpoint_every": 250, **options}
    adam = Adam(rate, beta1=0.5, beta2=0.95, final=rate / 10)
    source = source_of(procedural, data, size, seed)
    source = with_mirror_images(source) if flips else source
    natural = natural_light_weight if are_photographs(data) else photograph_weight
    weights = Weights(photograph_weight, natural, penalty_scale)
    light = Light(probes, samples)
    return Recipe(
        generator=partial(StationaryMaterials, size=size, channels=channels),
        discriminator=partial(TextureDiscriminator, channels=discriminator_channels, group=options.get("batch")),
        panels=panels_of(source, views, observations or observations_of(data), (maps, renderings), light, weights),
        loss=Relativistic(),
        penalty=R1R2(gamma * SCALE**2, every=4),
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        balance_every=16,
        steps=4000,
        seed=seed,
    ).configured(options)


def materials_paper(
    procedural: Materials,
    *,
    data: Path | None = None,
    views: Views = "known",
    observations: tuple[str, ...] = (*MAPS, "top", "grazing"),
    maps: int = 500,
    renderings: int = 250,
    probes: Path | None = None,
    size: int = 64,
    samples: int = 32,
    seed: int = 0,
    channels: int = 512,
    discriminator_channels: int = 64,
    **options: Unpack[Options],
) -> Recipe:
    """Materials with the networks, the loss and the rates of the paper's section 2: DCGAN, minibatch discrimination.

    The paper names neither its loss nor its batch; these are DCGAN's. As in `materials`, images are brought to one mean
    and deviation, and k_s is the reflectance itself.

    Args:
        procedural: makes the materials where there are no `data`.
        data: as in `materials`.
        views: known (a discriminator for each observation) or direct (one of all maps jointly, with as many images in
            all).
        observations: which to use, by name.
        maps: samples of each map, at most as many as `data` has.
        renderings: pictures of each kind of photograph, at most as many as `data` has.
        probes: natural light: a folder, an .npz or one file (default: five procedural probes).
        size: pixels a side.
        samples: Monte Carlo samples a pixel, where light is not directional.
        seed: of the weights, of every draw, and of the collections.
        channels: of the generator's 4² level.
        discriminator_channels: of the discriminators' first level.
        options: fields of `Recipe`.
    """
    options = {"batch": 64, **options}
    adam = Adam(1e-4, beta1=0.5, beta2=0.9)
    source = source_of(procedural, data, size, seed)
    return Recipe(
        generator=partial(DCGANMaterials, size=size, channels=channels),
        discriminator=partial(DCGANDiscriminator, channels=discriminator_channels, group=options.get("batch")),
        panels=panels_of(source, views, observations, (maps, renderings), Light(probes, samples)),
        loss=Logistic(),
        penalty=None,
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        steps=50_000,
        seed=seed,
    ).configured(options)


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


def source_of(procedural: Materials, data: Path | None, size: int, seed: int) -> Source:
    """Return where images come from: a procedural data set, the materials of `data`, or folders of pictures."""
    if data is not None and are_photographs(data):
        return lambda observation, count: _first(
            Collection.photographs(data, observation.name, size).floats(), count, seed
        )
    found = None if data is None else textures_of(data, size)

    def images(observation: Observation, count: int) -> Tensor:
        own = derived_seed(seed, 0, f"materials/{observation.name}")
        if found is None:
            require_memory(64 * count * size**2, f"making {count} materials", "lower --size or --maps, or give --data")
            x = procedural(count, size, own)
        elif found.shape[-1] == size:
            x = _first(found, count, own)
        else:
            x = material_patches(found, count, size, own)
        return observe(x, [observation], seed=own).floats()

    return images


def textures_of(data: Path, size: int) -> Tensor:
    """Return the maps of `data`: an .npz as it is, texture sets larger than the patches that are cut out of them."""
    return Collection.materials(data, None if data.suffix == ".npz" else ENLARGED * size).warn_skipped().floats()


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
    first = {"normal": 0, "itself": MAPS["normal"].start}.get(observation)
    if first is not None:
        for axis, channel in ((3, first), (2, first + 1)):
            if axis in axes:
                flipped[:, channel] *= -1
    return flipped


def observations_of(data: Path | None) -> tuple[str, ...]:
    """Return the observations that `data` has sub-folders for; else the maps, flash, coloured and ambient."""
    found = () if data is None else photographed(data)
    return found or (*MAPS, "flash", "coloured", "ambient")


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
    if not UNKNOWN_LIGHT & set(names):
        return None
    return procedural_probes(height)[0] if probes is None else read_probes(probes, height)[0]


def observation_of(name: str, natural: Tensor | None, samples: int) -> Observation:
    """Return the observation of this name.

    Raises:
        UserError: for an unknown name.
    """
    if name in MAPS:
        return Observation(name, Selection(name))
    if name not in VIEWED_FROM:
        raise UserError(f"observations: there is none called {name!r}; choose from {', '.join((*MAPS, *VIEWED_FROM))}")
    hard = dict.fromkeys(("flash", "lamp", "raking"), "directional")
    lighting = {**hard, "coloured": "coloured", "ambient": "ambient"}.get(name, natural)
    assert lighting is not None
    rendering = Rendering(lighting, Reflection("albedo"), Sampling(samples))
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


def _of(function: Callable[..., Recipe], procedural: Materials, name: str) -> Callable[..., Recipe]:
    """Return the recipe of a procedural data set, without that parameter."""

    @wraps(function)
    def made(**flags: Any) -> Recipe:
        return function(procedural, **flags)

    signature = inspect.signature(function)
    rest = [p for p in signature.parameters.values() if p.name != "procedural"]
    vars(made)["__signature__"] = signature.replace(parameters=rest)
    made.__name__ = made.__qualname__ = name
    return resumable(made)


PROCEDURAL: dict[str, Materials] = {"wood": wood, "metal": metal, "plastic": plastic, "correlated": correlated}

wood_materials = _of(materials, wood, "wood_materials")
metal_materials = _of(materials, metal, "metal_materials")
plastic_materials = _of(materials, plastic, "plastic_materials")
correlated_materials = _of(materials, correlated, "correlated_materials")
wood_paper = _of(materials_paper, wood, "wood_paper")
metal_paper = _of(materials_paper, metal, "metal_paper")
plastic_paper = _of(materials_paper, plastic, "plastic_paper")
