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
overhead     the same lamps 12 ± 5° from the normal
slanting     the same lamps 36 ± 5° from the normal
ambient      from the top, constant light
daylight     from the top, daylight or light of a room that nobody measured (`data.daylight_probes`)
============ =====================================================================================
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import partial, wraps
from pathlib import Path
from typing import Any

from typing_extensions import Unpack

from ..adversarial.losses import Logistic, Relativistic
from ..adversarial.matching import Matching
from ..adversarial.penalties import R1R2
from ..data import correlated, fabric, metal, plastic, wood
from ..networks import DCGANDiscriminator, DCGANMaterials, StationaryMaterials, TextureDiscriminator
from ..ops.maps import MAPS
from ..projections.standardised import SCALE
from ..training import Adam, Options, Recipe, resumable
from .defaults import with_default
from .material_panels import (
    Light,
    Materials,
    Views,
    Weights,
    are_photographs,
    observations_of,
    panels_of,
    source_of,
    with_mirror_images,
)

RENDERED, PHOTOGRAPHED = 8, 32
"""Monte Carlo samples a pixel, where real images are rendered with as many, and where they are photographs, which have
no such noise: of 8 samples its deviation at grazing angles is over twice that of the images."""
PENALTY_SCALE = 20.0
NATURAL_LIGHT_WEIGHT = 0.5
ALIKE = 1e-5
"""Deviation of a statistic below which all images have it: of speculars of three channels few may have a colour."""
ALL = 2**31
"""More pictures than any folder has."""


def counted(given: int | None, made: int, photographed: bool) -> int:
    """Return how many images of a kind there are to be: those given, else all photographs, or so many that are made."""
    if given is not None:
        return given
    return ALL if photographed else made


def materials(
    procedural: Materials,
    *,
    data: Path | None = None,
    views: Views = "known",
    observations: tuple[str, ...] | None = None,
    maps: int | None = None,
    renderings: int | None = None,
    probes: Path | None = None,
    size: int = 64,
    samples: int | None = None,
    seed: int = 0,
    channels: int = 128,
    discriminator_channels: int = 16,
    rate: float = 1.5e-3,
    gamma: float = 0.5,
    photograph_weight: float = 3.0,
    natural_light_weight: float = NATURAL_LIGHT_WEIGHT,
    penalty_scale: float = PENALTY_SCALE,
    matching: float = 2.0,
    flips: bool = False,
    coloured_specular: bool = False,
    waves: bool = True,
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
            coloured, ambient and overhead).
        maps: samples of each map, at most as many as `data` has (default: all pictures of a folder that has
            sub-folders for observations, else 500).
        renderings: pictures of each kind of photograph, at most as many as `data` has (default: all of such a folder,
            else 250).
        probes: natural light: a folder, an .npz or one file (default: five procedural probes).
        size: pixels a side.
        samples: Monte Carlo samples a pixel, where light is not directional (default: 32 if they are compared with
            photographs, 8 if real images are rendered too).
        seed: of the weights, of every draw, and of the collections.
        channels: of the generator's 4² level.
        discriminator_channels: of the discriminators' first level.
        rate: learning rate at the start; it falls to a tenth along a cosine.
        gamma: weight of R1 and R2, in units of images brought to one deviation.
        photograph_weight: weight of photographs in the loss of the generator, where a map has 1; photographs determine
            how maps are correlated.
        natural_light_weight: the same for photographs of `data` in `top`, `grazing` and `daylight`, with `probes` too:
            effects of unknown light should not be painted into the maps.
        penalty_scale: factor of gamma for photographs, of which a few hundred would otherwise be memorised.
        matching: weight of the statistics of the second order that images are to share with real ones (`Matching`),
            where the discriminators' loss has 1, at the start; it falls to a quarter. 0: none.
        flips: learn from mirror images too, of maps and of those photographs whose light allows it.
        coloured_specular: give the specular albedo three channels, as of gold and copper; steps take longer.
        waves: give the generator waves along rows and columns, of which patterns that repeat themselves can be made.
        options: fields of `Recipe`.
    """
    options = {"batch": 8, "checkpoint_every": 250, **options}
    adam = Adam(rate, beta1=0.5, beta2=0.95, final=rate / 10)
    # Nothing is given where there are none: runs of before there were the flags are described as they were.
    own = ({"specular_channels": 3} if coloured_specular else {}) | ({"cycles": size // 4} if waves else {})
    procedural = partial(procedural, coloured=True) if coloured_specular else procedural
    source = source_of(procedural, data, size, seed, coloured_specular)
    source = with_mirror_images(source) if flips else source
    photographed = are_photographs(data)
    counts = (counted(maps, 500, photographed), counted(renderings, 250, photographed))
    natural = natural_light_weight if photographed else photograph_weight
    weights = Weights(photograph_weight, natural, penalty_scale)
    taken = (PHOTOGRAPHED if photographed else RENDERED) if samples is None else samples
    return Recipe(
        generator=partial(StationaryMaterials, size=size, channels=channels, **own),
        discriminator=partial(TextureDiscriminator, channels=discriminator_channels),
        panels=panels_of(source, views, observations or observations_of(data), counts, Light(probes, taken), weights),
        loss=Relativistic(),
        penalty=R1R2(gamma * SCALE**2, every=4),
        matching=Matching(matching, matching / 4, alike=ALIKE if coloured_specular else None) if matching else None,
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
        discriminator=partial(DCGANDiscriminator, channels=discriminator_channels),
        panels=panels_of(source, views, observations, (maps, renderings), Light(probes, samples)),
        loss=Logistic(),
        penalty=None,
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        steps=50_000,
        seed=seed,
    ).configured(options)


def _of(function: Callable[..., Recipe], procedural: Materials, name: str) -> Callable[..., Recipe]:
    """Return the recipe of a procedural data set, without that parameter."""

    @wraps(function)
    def made(**flags: Any) -> Recipe:
        return function(procedural, **flags)

    signature = inspect.signature(function)
    rest = [p for p in signature.parameters.values() if p.name != "procedural"]
    vars(made)["__signature__"] = signature.replace(parameters=rest)
    made.__name__ = made.__qualname__ = name
    return with_observations(resumable(made)) if function is materials else resumable(made)


with_observations = with_default("observations", lambda arguments: observations_of(arguments.get("data")))


PROCEDURAL: dict[str, Materials] = {
    "materials": wood,
    "wood": wood,
    "metal": metal,
    "plastic": plastic,
    "fabric": fabric,
    "correlated": correlated,
}

surface_materials = _of(materials, wood, "surface_materials")
wood_materials = _of(materials, wood, "wood_materials")
metal_materials = _of(materials, metal, "metal_materials")
plastic_materials = _of(materials, plastic, "plastic_materials")
fabric_materials = _of(materials, fabric, "fabric_materials")
correlated_materials = _of(materials, correlated, "correlated_materials")
wood_paper = _of(materials_paper, wood, "wood_paper")
metal_paper = _of(materials_paper, metal, "metal_paper")
plastic_paper = _of(materials_paper, plastic, "plastic_paper")
