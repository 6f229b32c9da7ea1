"""Surface materials from maps and photographs of them: the recipes of the paper's Part II, and modern ones.

Each observation has a collection of its own, drawn independently from a world of materials: no two need show the same
one; and a discriminator of its own. Which are used, and how many of each, is the experiment:

============ =====================================================================================
observation  what is seen
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

from .._random import derived_seed, generator_at
from .._types import UserError
from ..adversarial.losses import Logistic, Relativistic
from ..adversarial.penalties import R1R2
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
from ..projections.priors import Product
from ..projections.rendering import Rendering, rendering_prior
from ..projections.selection import Selection
from ..projections.standardised import SCALE, standardised
from ..training.recipe import Adam, Recipe

World = Callable[[int, int, int], Tensor]
Views = Literal["known", "direct"]
SEEN_FROM = {"top": 0.0, "grazing": 80.0, "flash": 0.0, "lamp": 0.0, "raking": 0.0, "coloured": 0.0, "ambient": 0.0}
MIRRORED = {
    **dict.fromkeys((*MAPS, "flash", "lamp", "ambient", "itself"), ((3,), (2,), (2, 3))),
    "raking": ((2,),),
    "top": ((2, 3),),
}
"""Which mirror images of what is seen are what is seen of mirrored materials: axes to flip. Natural light has no mirror
image, but stands turned by half as well as not; cameras are within 5° of the normal."""
STANDING = {"raking": (math.radians(60), math.pi), "coloured": (math.radians(60), math.pi)}
"""From the normal, and around it, of lamps that stand where they are."""
BALANCE = 16  # steps between two measurements of how hard each way of looking pulls
SMOOTHING = 20.0
UNKNOWN_LIGHT = {"top", "grazing"}
NATURAL = 0.5
ENLARGED = 4  # folders of textures are read at so many times the size of what is cut out of them


def materials(
    world: World,
    *,
    data: Path | None = None,
    views: Views = "known",
    looks: tuple[str, ...] | None = None,
    maps: int = 500,
    renderings: int = 250,
    probes: Path | None = None,
    size: int = 64,
    samples: int = 8,
    steps: int | None = None,
    minutes: float | None = None,
    seed: int = 0,
    batch: int = 8,
    channels: int = 128,
    judge: int = 16,
    rate: float = 1.5e-3,
    gamma: float = 0.5,
    emphasis: float = 3.0,
    natural: float = NATURAL,
    smoothing: float = SMOOTHING,
    flips: bool = False,
    checkpoint_every: int = 250,
) -> Recipe:
    """Materials from any mix of maps and photographs; `wood`, `metal` and `plastic` are this with their world.

    Args:
        world: (count, size, seed) → maps (count, 8, size, size), where there is no `data`.
        data: a folder with a sub-folder of pictures for each look; or folders of textures, or an .npz of maps, of
            which patches are seen through `looks`; the embedded world unless given.
        views: known, a discriminator for each look; or direct, one of all maps at once, with as many images in all.
        looks: the observations, by name; unless given, those that `data` has sub-folders for, or the four maps, flash,
            coloured and ambient, each of which tells something else of how the maps go together.
        maps: how many samples each map has, or as many as `data` has.
        renderings: how many pictures each kind of photograph has, likewise.
        probes: natural light: a folder, an .npz or one file; five built in unless given.
        size: pixels a side.
        samples: a pixel, where light is not directional.
        steps: budget in steps; 4000 if neither steps nor minutes is given.
        minutes: budget in minutes of the clock.
        seed: of the weights, of every draw, and of the collections.
        batch: materials an update.
        channels: of the generator's 4² level.
        judge: channels of the discriminators' first level.
        rate: learning rate at the start; it falls to a tenth along a cosine.
        gamma: weight of R1 and R2, in units of what is seen brought to one deviation.
        emphasis: how much photographs count in the loss of the generator, where a map counts 1: they tell how maps go
            together.
        natural: the same of `data`'s own photographs under natural light: nobody knows that light, and what another
            light would explain is not to be painted into the maps.
        smoothing: how many times gamma counts for photographs: some hundred of them would be learned by heart.
        flips: learn from mirror images too, of maps and of those photographs whose light allows it: as if the mirror
            image of each material were another one.
        checkpoint_every: steps between checkpoints.
    """
    adam = Adam(rate, beta1=0.5, beta2=0.95, final=rate / 10)
    source = source_of(world, data, size, seed)
    source = with_mirror_images(source) if flips else source
    care = Care(emphasis, natural if are_sightings(data) else emphasis, smoothing)
    return Recipe(
        generator=partial(StationaryMaterials, size=size, channels=channels),
        discriminator=partial(TextureDiscriminator, channels=judge, group=batch),
        looks=pairs_of(source, views, looks or looks_of(data), maps, renderings, probes, samples, care),
        loss=Relativistic(),
        penalty=R1R2(gamma * SCALE**2, every=4),
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        balance=BALANCE,
        batch=batch,
        steps=4000 if steps is None and minutes is None else steps,
        minutes=minutes,
        seed=seed,
        checkpoint_every=checkpoint_every,
    )


def materials_paper(
    world: World,
    *,
    data: Path | None = None,
    views: Views = "known",
    looks: tuple[str, ...] = (*MAPS, "top", "grazing"),
    maps: int = 500,
    renderings: int = 250,
    probes: Path | None = None,
    size: int = 64,
    samples: int = 32,
    steps: int | None = None,
    minutes: float | None = None,
    seed: int = 0,
    batch: int = 64,
    channels: int = 512,
    judge: int = 64,
    checkpoint_every: int = 500,
) -> Recipe:
    """Materials with the networks, the loss and the rates of the paper's section 2: DCGAN, minibatch discrimination.

    The paper names neither its loss nor its batch; these are DCGAN's. As in `materials`, what is seen is brought to one
    mean and deviation, and k_s is the reflectance itself.

    Args:
        world: (count, size, seed) → maps (count, 8, size, size), where there is no `data`.
        data: as in `materials`.
        views: known, a discriminator for each look; or direct, one of all maps at once, with as many images in all.
        looks: the observations, by name.
        maps: how many samples each map has, or as many as `data` has.
        renderings: how many pictures each kind of photograph has, likewise.
        probes: natural light: a folder, an .npz or one file; five built in unless given.
        size: pixels a side.
        samples: a pixel, where light is not directional.
        steps: budget in steps; 50000 if neither steps nor minutes is given.
        minutes: budget in minutes of the clock.
        seed: of the weights, of every draw, and of the collections.
        batch: materials an update.
        channels: of the generator's 4² level.
        judge: channels of the discriminators' first level.
        checkpoint_every: steps between checkpoints.
    """
    adam = Adam(1e-4, beta1=0.5, beta2=0.9)
    source = source_of(world, data, size, seed)
    return Recipe(
        generator=partial(DCGANMaterials, size=size, channels=channels),
        discriminator=partial(DCGANDiscriminator, channels=judge, group=batch),
        looks=pairs_of(source, views, looks, maps, renderings, probes, samples),
        loss=Logistic(),
        penalty=None,
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        batch=batch,
        steps=50_000 if steps is None and minutes is None else steps,
        minutes=minutes,
        seed=seed,
        checkpoint_every=checkpoint_every,
    )


class Care(NamedTuple):
    """What photographs count for the generator, under lamps and under natural light; and their gradient penalty."""

    lamps: float = 1.0
    natural: float = 1.0
    smoothing: float = 1.0


PLAIN = Care()

Source = Callable[[Observation, int], Tensor]
"""(which observation, how many) → what it saw of materials of its own."""


def source_of(world: World, data: Path | None, size: int, seed: int) -> Source:
    """Where pictures come from: a world without end, the materials of `data`, or folders of pictures, one a look."""
    if data is not None and are_sightings(data):
        return lambda look, count: _first(Collection.photographs(data, look.name, size).items, count, seed)
    found = None if data is None else textures_of(data, size)

    def see(look: Observation, count: int) -> Tensor:
        own = derived_seed(seed, 0, f"materials/{look.name}")
        if found is None:
            things = world(count, size, own)
        elif found.shape[-1] == size:
            things = _first(found, count, own)
        else:
            things = material_patches(found, count, size, own)
        return observe(things, [look], seed=own).items

    return see


def textures_of(data: Path, size: int) -> Tensor:
    """The maps of `data`: an .npz as it is, texture sets larger than what is cut out of them."""
    return Collection.materials(data, None if data.suffix == ".npz" else ENLARGED * size).warn_skipped().items


def are_sightings(data: Path | None) -> bool:
    """Whether a folder has sub-folders of pictures, one a look."""
    return data is not None and bool(photographed(data))


def with_mirror_images(source: Source) -> Source:
    """The same pictures and all mirror images that light and camera allow; x and y of mirrored normals change sign."""

    def see(look: Observation, count: int) -> Tensor:
        seen = source(look, count)
        return torch.cat([seen, *(mirrored(look.name, seen, axes) for axes in MIRRORED.get(look.name, ()))])

    return see


def mirrored(look: str, seen: Tensor, axes: tuple[int, ...]) -> Tensor:
    """What is seen, flipped along rows (2), columns (3) or both."""
    flipped = seen.flip(axes)
    first = {"normal": 0, "itself": MAPS["normal"].start}.get(look)
    if first is not None:
        for axis, channel in ((3, first), (2, first + 1)):
            if axis in axes:
                flipped[:, channel] *= -1
    return flipped


def looks_of(data: Path | None) -> tuple[str, ...]:
    """The observations that `data` has sub-folders for, if it has any; else the maps, flash, coloured and ambient."""
    found = () if data is None else photographed(data)
    return found or (*MAPS, "flash", "coloured", "ambient")


def pairs_of(
    source: Source,
    views: Views,
    names: Sequence[str],
    maps: int,
    renderings: int,
    probes: Path | None,
    samples: int,
    care: Care = PLAIN,
) -> list[tuple[Observation, Collection]]:
    """Each observation and what it saw; or the materials themselves, as many images in all."""
    counts = dict.fromkeys(MAPS, maps) | dict.fromkeys(SEEN_FROM, renderings)
    chosen = [name for name in dict.fromkeys(names) if counts.get(name, 1)]
    natural = natural_light(chosen, probes)
    ways = [way_of(name, natural, samples, care) for name in chosen]
    if not ways:
        raise UserError("looks: name at least one observation, with at least one sample")
    if views == "direct":
        itself = Observation("itself", Identity(), Product())
        return [seen_by(itself, source(itself, max(1, sum(counts[name] for name in chosen) // len(MAPS))))]
    return [seen_by(way, source(way, counts[way.name])) for way in ways]


def _first(items: Tensor, count: int, seed: int) -> Tensor:
    """As many as asked for, or all there are, in an order of their own."""
    return items[torch.randperm(len(items), generator=generator_at(seed, 0, "order"))[:count]]


def natural_light(names: Sequence[str], probes: Path | None, height: int = 32) -> Tensor | None:
    """Environments (K, 3, height, 2 height): those of a file or folder, or the built-in ones; None if not needed."""
    if not UNKNOWN_LIGHT & set(names):
        return None
    return procedural_probes(height)[0] if probes is None else read_probes(probes, height)[0]


def way_of(name: str, natural: Tensor | None, samples: int, care: Care = PLAIN) -> Observation:
    """The observation of this name."""
    if name in MAPS:
        return Observation(name, Selection(name), Product())
    if name not in SEEN_FROM:
        raise UserError(f"looks: there is no observation {name!r}; choose from {', '.join((*MAPS, *SEEN_FROM))}")
    hard = dict.fromkeys(("flash", "lamp", "raking"), "directional")
    lighting = {**hard, "coloured": "coloured", "ambient": "ambient"}.get(name, natural)
    assert lighting is not None
    rendering = Rendering(lighting, Reflection("albedo"), Sampling(samples))
    light, azimuth = ({"flash": (0.0, None)} | STANDING).get(name, (None, None))
    prior = rendering_prior(rendering, math.radians(SEEN_FROM[name]), light, light_azimuth=azimuth)
    return Observation(name, rendering, prior, care.natural if name in UNKNOWN_LIGHT else care.lamps, care.smoothing)


def seen_by(look: Observation, pictures: Tensor) -> tuple[Observation, Collection]:
    """An observation whose results are brought to the mean and deviation of what it saw, and that, likewise."""
    brought = standardised(look.projection, pictures)
    seen = Collection(brought.standardise(pictures), source=f"{len(pictures)} through {look.name}")
    return Observation(look.name, brought, look.prior, look.weight, look.smoothing), seen


def _of(function: Callable[..., Recipe], world: World, name: str) -> Callable[..., Recipe]:
    """The recipe of a world, without that parameter."""

    @wraps(function)
    def recipe(**flags: Any) -> Recipe:
        return function(world, **flags)

    signature = inspect.signature(function)
    rest = [p for p in signature.parameters.values() if p.name != "world"]
    vars(recipe)["__signature__"] = signature.replace(parameters=rest)
    recipe.__name__ = recipe.__qualname__ = name
    return recipe


WORLDS: dict[str, World] = {"wood": wood, "metal": metal, "plastic": plastic, "correlated": correlated}

wood_materials = _of(materials, wood, "wood_materials")
metal_materials = _of(materials, metal, "metal_materials")
plastic_materials = _of(materials, plastic, "plastic_materials")
correlated_materials = _of(materials, correlated, "correlated_materials")
wood_paper = _of(materials_paper, wood, "wood_paper")
metal_paper = _of(materials_paper, metal, "metal_paper")
plastic_paper = _of(materials_paper, plastic, "plastic_paper")
