"""The parts of recipes for shapes: silhouettes and their views, framing, the assignment, regularisers."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple, TypedDict

from torch import Tensor, nn

from .._random import derived_seed
from .._types import UserError
from ..adversarial.axisymmetric import Axisymmetric
from ..adversarial.inflated import Inflated
from ..adversarial.regularisers import Centred, Connected, Rectilinear, Regulariser, Regularisers, Solid, Varied
from ..assignment import LearnedLatent, Panel, Predicted
from ..data import Collection, chairs, holds_materials, mapped, observe, plane_of_symmetry, read, with_flips
from ..data.readers.paths import holds_shapes
from ..data.sampling import spread_rows
from ..domains import Volumes
from ..networks import Discriminator, LowRankGenerator
from ..ops.feet import ROUND, round_feet
from ..ops.framing import LEAST_HEIGHT, NARROW, WIDEST, aspect, common_fill, common_height
from ..ops.outlines import LEVEL, level_share
from ..ops.thin_parts import level_of_thin_parts
from ..projections.base import Projection
from ..projections.cropped import Cropped
from ..projections.observation import Observation
from ..projections.silhouette import Silhouette, azimuth_bins, azimuth_elevation_bins, mirrored_views
from ..training import Adam
from ..training.memory import require_memory_to_train
from .pairing import Views, panel_of
from .sizes import check_size_of_shapes

PROCEDURAL_CHAIRS = 1000
BANDS = 12
CHECKED = 1024
"""Pictures that are looked at to tell whether and how they were cropped, and whether cameras were level."""
ENLARGED = 2
"""How many times as large as silhouettes pictures are read that are framed anew."""
FEET = 256
"""Pictures of which the feet are looked at."""
HELD_OUT, MOST_HELD_OUT = 0.1, 6554


class Pictures(NamedTuple):
    """A collection as its observations make pictures, and what their outlines tell.

    Of silhouettes that were not rendered here `feet` is the share of round feet, else 0. `narrowest` is how wide the
    narrowest pictures are over their height, infinity of volumes.
    """

    collection: Collection
    observations: tuple[Observation, ...]
    feet: float = 0.0
    narrowest: float = math.inf


class Weights(NamedTuple):
    """Of the preferences for full volumes, rectangular plans, variety, one piece, thickness and bodies of revolution.

    `axisymmetric` None: that of `Axisymmetric` if most pictures show a round foot, else 0.
    """

    solid: float
    rectilinear: float
    varied: float
    connected: float
    inflated: float
    axisymmetric: float | None


def preferences(
    views: Views, weights: Weights, pictures: Pictures, bands: int | None, mirror: bool | Literal["z"]
) -> Regulariser | None:
    """Return the preferences whose weight is not zero.

    Only in silhouettes hollow volumes look full, and only of unknown views any plans may be right: rectangles that
    differ from one another and, across their plane of symmetry, are as thick as they look wide and the narrowest
    pictures allow, or what is round.
    Shapes that are seen in cropped pictures are kept in the middle: sideways by level cameras, by others from top to
    bottom too.
    """
    solid, rectilinear, varied, connected, inflated, axisymmetric = weights
    if axisymmetric is None:
        axisymmetric = Axisymmetric().weight if pictures.feet > ROUND else 0.0
    # All are made, so that a weight that makes no sense is refused whether or not it is used.
    full = [Solid(solid, solid / 10)] if solid else []
    rotated = [Axisymmetric(axisymmetric)] if axisymmetric else []
    boxes = [Rectilinear(rectilinear, 0.3 * rectilinear)] if rectilinear else []
    different = [Varied(varied)] if varied else []
    thick = [Inflated(inflated, pictures.narrowest)] if inflated else []
    terms: list[Regulariser] = [*full] if views != "direct" else []
    if views not in ("known", "direct"):
        terms += rotated or [*boxes, *different, *(thick if mirror else [])]
    terms += [Connected(connected)] if connected else []
    if isinstance(pictures.observations[0].projection, Cropped):
        terms += [Centred(axes="xz" if bands in (None, 1) else "xyz")]
    return Regularisers(tuple(terms)) if len(terms) > 1 else next(iter(terms), None)


class Networks(TypedDict):
    """What makes them, and the domain of what they make."""

    generator: Callable[[], LowRankGenerator]
    discriminator: Callable[[tuple[int, ...], int], nn.Module]
    domain: Volumes


def networks_of(
    panel: Panel, channels: int, rank: int, mirror: bool | Literal["z"], hull: bool | float, direct: bool
) -> Networks:
    """Return generator and discriminator, of silhouettes or of volumes; sizes are unknown of cropped pictures."""
    size = panel.shape[-1]
    judge = partial(Discriminator, channels=16 if direct else 32, shared=4, bottleneck=256)
    return {
        "generator": partial(LowRankGenerator, size=size, channels=channels, rank=rank, mirror=mirror, hull=hull),
        "discriminator": partial(judge, common=True, volumetric=direct),
        "domain": Volumes(sized=not isinstance(panel.projection, Cropped)),
    }


class Optimisers(TypedDict):
    """Of both networks."""

    generator_optimiser: Adam
    discriminator_optimiser: Adam


def falling_adams(rate: float) -> Optimisers:
    """Return Adam whose learning rate falls to a tenth, for both networks."""
    adam = Adam(rate, beta1=0.0, beta2=0.95, final=rate / 10)
    return {"generator_optimiser": adam, "discriminator_optimiser": adam}


def pictures_of(
    data: Path | None,
    views: Views,
    size: int | None,
    density: float,
    bins: int,
    bands: int | None,
    views_per_shape: int,
    binary: bool,
    seed: int,
) -> Pictures:
    """Return a collection as its observations make pictures, and what these tell.

    The reader crops the pictures of a folder; arrays are taken for cropped if all look so. Others, rendered silhouettes
    and volumes stay as they are. Cropped ones are read twice as large, since most become smaller.
    """
    check_size_of_shapes(size)
    silhouette = Silhouette(size=size, rule="absorption", density=density)
    observations = silhouette_views(silhouette, bins, bands)
    by_reader = data is not None and Path(data).is_dir() and not holds_shapes(Path(data))
    enlarged = ENLARGED if by_reader else 1
    collection = silhouettes_of(data, views, observations, views_per_shape, binary, seed, enlarged)
    if collection.shape[0] != 1:
        return Pictures(collection, observations)
    some = some_of(collection)
    if is_rendered(collection):
        return Pictures(collection, observations, narrowest=aspect(some, NARROW))
    if not bool((some > 0.5).any()):
        raise UserError(f"{collection.source}: no picture has anything above 0.5; silhouettes are 1 inside, 0 outside")
    if data is not None and by_reader and holds_materials(data):
        warnings.warn(
            f"{data}: is named as materials are; shapes take each picture for a silhouette. See unproject data inspect "
            f"{data}, and train materials",
            stacklevel=2,
        )
    if not by_reader and common_fill(some) is None:
        return Pictures(collection, observations, *told_by(some))
    larger = collection if data is None or by_reader else read(data, size=ENLARGED * collection.shape[-1])
    some = some_of(larger)
    cropped = Cropped(silhouette, common_height(some))
    if cropped.height == LEAST_HEIGHT:
        wide = f"{WIDEST / LEAST_HEIGHT:.1f} times as wide as high"
        warnings.warn(f"{larger.source}: many pictures are over {wide}: they are cut at both sides", stacklevel=2)
    cropped = replace(cropped, level=level_of_thin_parts(cropped.prepare(some)))
    return Pictures(mapped(larger, cropped.prepare), silhouette_views(cropped, bins, bands), *told_by(some))


def told_by(silhouettes: Tensor) -> tuple[float, float]:
    """Return the share of round feet, and the width of the narrowest over their height."""
    return round_feet(silhouettes[spread_rows(len(silhouettes), FEET)]), aspect(silhouettes, NARROW)


def some_of(collection: Collection) -> Tensor:
    """Return pictures evenly spread over a collection, CHECKED at most."""
    return collection.batch(spread_rows(len(collection), CHECKED))


def is_rendered(collection: Collection) -> bool:
    """Whether silhouettes were rendered here, of volumes."""
    return collection.latents is not None and "view" in collection.latents


def camera_of(
    views: Views, bands: int | None, collection: Collection, projection: Projection
) -> tuple[LearnedLatent, ...]:
    """Return the elevation if it is learned: of renderings of unknown view whose outlines do not tell that it is 0.

    Cameras of cropped pictures count as level. With elevations to learn, generators explain by them what other shapes
    should; where size and place are unknown as well, they end in a wrong world (docs/results.md). Learned elevations
    are positive, since a silhouette from below is the flipped one from above and behind.
    """
    if views in ("known", "direct") or bands is not None or is_rendered(collection) or isinstance(projection, Cropped):
        return ()
    if level_share(some_of(collection)) > LEVEL:
        return ()
    degree = math.radians(1)
    return (LearnedLatent("elevation", 8 * degree, 5 * degree, 0.0, 75 * degree, begin=0.25, negligible=2 * degree),)


def silhouette_views(silhouette: Projection, bins: int, bands: int | None) -> tuple[Observation, ...]:
    """Return bins of azimuth at elevation 0, or times bands of elevation."""
    bands = 1 if bands is None else bands
    if bins < 1 or bands < 1 or bins % 2 and bins > 1:
        raise UserError(f"bins={bins}, bands={bands}: give at least one of each, and an even number of bins")
    if bands > BANDS:
        raise UserError(f"bands={bands}: of 15° each, at most {BANDS} reach from pole to pole")
    return azimuth_bins(bins, silhouette) if bands == 1 else azimuth_elevation_bins(bins, bands, silhouette)


def silhouettes_of(
    data: Path | None,
    views: Views,
    observations: tuple[Observation, ...],
    views_per_shape: int,
    binary: bool,
    seed: int,
    enlarged: int = 1,
) -> Collection:
    """Return the silhouettes that `data` holds, or those rendered of its volumes; for direct training the volumes.

    Pictures are `enlarged` times as large as those of the observations.
    """
    silhouette = observations[0].projection
    assert isinstance(silhouette, Silhouette) and silhouette.size is not None
    size = silhouette.size
    collection = read_or_make(data, enlarged * size)
    volumetric = collection.shape == (size, size, size)
    if views == "direct":
        if not volumetric:
            raise UserError(
                f"{collection.source}: direct training needs volumes; give a 3-D collection or other --views"
            )
        return collection
    if not volumetric:
        return collection
    where = derived_seed(seed, 0, "silhouettes")
    return observe(collection, observations, views_per_shape, where, binary=binary)


def read_or_make(data: Path | None, size: int) -> Collection:
    """Read the collection of a path; without one, make procedural chairs."""
    if data is None:
        made = f"making {PROCEDURAL_CHAIRS} chairs of {size}³ voxels takes"
        require_memory_to_train(2 * 4 * PROCEDURAL_CHAIRS * size**3, made, "lower --size or give --data")
        return Collection(chairs(PROCEDURAL_CHAIRS, size, seed=0))
    found = read(data, size=size).warn_skipped()
    if len(found.shape) != 3:
        raise UserError(f"{data}: holds line integrals; shapes are learned from pictures or volumes")
    return found


def mirror_of(mirror: bool, views: Views, collection: Collection) -> bool | Literal["z"]:
    """Return what generators are told: if asked to mirror, the plane that known views or volumes are symmetric about.

    Of unknown views the plane may be any, so that it is x = 0.
    """
    if not mirror or views not in ("known", "direct"):
        return mirror
    plane = plane_of_symmetry(collection)
    return "z" if plane == "z" else plane is not None


def mirrored_by(symmetry: bool | Literal["z"], bins: int, bands: int | None) -> tuple[int, ...] | None:
    """Return the view that the mirror image of each shows, of symmetric shapes; None of others."""
    return mirrored_views(bins, bands or 1) if symmetry else None


def split_panel(
    views: Views,
    bands: int | None,
    observations: Sequence[Observation],
    collection: Collection,
    predicted: Predicted,
    split_seed: int | None,
    flips: bool,
) -> Panel:
    """Return the panel with a tenth of the images held out, unless there is no seed for that or training is direct.

    Of more than 65,536 images no more are held out, since every round predicts them all.
    """
    split = split_seed is not None and views != "direct"
    share = min(HELD_OUT, MOST_HELD_OUT / len(collection))
    kept, held_out = collection.split(share, split_seed or 0) if split else (collection, None)
    panel = panel_of(views, observations, with_flips(kept) if flips else kept, predicted, held_out)
    return replace(panel, learned=camera_of(views, bands, collection, observations[0].projection))
