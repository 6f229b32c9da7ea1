"""Shapes from silhouettes: the recipes of the paper's Part I, and modern ones.

The four arms of every comparison differ by `views` alone; `pairing` has the table.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Literal

from .._random import derived_seed
from .._types import UserError
from ..adversarial.losses import Hinge, Relativistic, Wasserstein
from ..adversarial.mean_shape_start import MeanShapeStart
from ..adversarial.penalties import R1R2, GradientPenalty
from ..adversarial.regularisers import Solid
from ..data import Collection, chairs, observe, read, with_flips
from ..networks import Discriminator, LowRankGenerator, VoxelGenerator
from ..projections.observation import Observation
from ..projections.silhouette import Silhouette, azimuth_bins, azimuth_elevation_bins
from ..training.recipe import Adam, Looks, Recipe
from .pairing import Views, little_and_often, modern_assignment, pair, paper_assignment

EMBEDDED_CHAIRS = 1000


def shapes(
    *,
    data: Path | None = None,
    views: Views = "predicted",
    size: int = 32,
    bins: int = 16,
    bands: int = 1,
    looks_per_shape: int = 16,
    binary: bool = False,
    flips: bool = False,
    steps: int | None = None,
    minutes: float | None = None,
    seed: int = 0,
    batch: int = 48,
    looks_each: int = 4,
    channels: int = 128,
    rank: int = 32,
    density: float = 2.0,
    rate: float = 1.5e-3,
    gamma: float = 0.1,
    solid: float = 0.1,
    rounds: int = 40,
    balance: float = 0.8,
    guess: bool = False,
    mirror: bool = True,
    precision: Literal["float32", "bfloat16"] = "float32",
    compile: bool = False,
    checkpoint_every: int = 500,
) -> Recipe:
    """Shapes from silhouettes, made for a laptop: low-rank generator, relativistic loss with lazy R1 + R2.

    Args:
        data: a folder of pictures, an .npz, or a 3-D collection; a family of chairs unless given.
        views: what is known of the views: predicted (nothing, but estimated image by image), learned (nothing, but
            how often each was taken is estimated), known, single (nothing, one discriminator head), or direct (no
            projection: train on the volumes themselves).
        size: voxels, and pixels, a side.
        bins: ways of looking: bins of azimuth.
        bands: times this many bands of elevation, 15° each, centred on the horizon; 1: all at elevation 0.
        looks_per_shape: silhouettes rendered of each shape of a 3-D collection.
        binary: cut rendered silhouettes at one half.
        flips: learn from the mirror images of the pictures too; for small collections.
        steps: budget in steps; 4000 if neither steps nor minutes is given.
        minutes: budget in minutes of the clock.
        seed: of the weights, of every draw, and of the rendered silhouettes.
        batch: images an update.
        looks_each: silhouettes an update of each generated shape.
        channels: width of the generator.
        rank: plane-line products an axis.
        density: what one full voxel stops is 1 - exp(-density).
        rate: learning rate at the start; it falls to a tenth along a cosine.
        gamma: weight of R1 and R2.
        solid: weight of the preference for full volumes at the start; it falls to a tenth along a line.
        rounds: how often views are predicted anew, evenly over the budget.
        balance: how far predicted views are drawn to equal numbers from everywhere, 0 to 1; lower it if most of
            your pictures were taken from one side.
        guess: start predicted views from those of one mean shape, fitted to all silhouettes, not from random ones: for
            things like cars, much longer than wide, whose views may never be told apart otherwise; chairs suffer.
        mirror: make only shapes that are symmetric left to right, as most things are; turn it off for others.
        precision: of the networks.
        compile: use torch.compile.
        checkpoint_every: steps between checkpoints.
    """
    silhouette = Silhouette(size=size, rule="absorption", density=density)
    adam = Adam(rate, beta1=0.0, beta2=0.95, final=rate / 10)
    first = MeanShapeStart(mirror=mirror, balance=balance) if guess else None
    return Recipe(
        generator=partial(
            LowRankGenerator, size=size, channels=channels, rank=rank, mirror=mirror, hull=views != "direct"
        ),
        discriminator=partial(
            Discriminator,
            channels=16 if views == "direct" else 32,
            shared=4,
            bottleneck=256,
            common=True,
            volumetric=views == "direct",
        ),
        looks=look_at(data, views, ways_of_looking(silhouette, bins, bands), looks_per_shape, binary, seed, flips),
        assignment=modern_assignment(views, replace(little_and_often(rounds, balance), first=first)),
        loss=Relativistic(),
        penalty=R1R2(gamma, every=8),
        regulariser=Solid(solid, solid / 10) if solid and views != "direct" else None,
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        batch=batch,
        looks_each=1 if views == "direct" else looks_each,
        steps=4000 if steps is None and minutes is None else steps,
        minutes=minutes,
        seed=seed,
        precision=precision,
        compile=compile,
        checkpoint_every=checkpoint_every,
    )


def shapes_paper(
    *,
    data: Path | None = None,
    views: Views = "predicted",
    size: int = 64,
    bins: int = 16,
    bands: int = 1,
    looks_per_shape: int = 16,
    binary: bool = False,
    steps: int | None = None,
    minutes: float | None = None,
    seed: int = 0,
    batch: int = 32,
    channels: int = 512,
    judge: int = 64,
    loss: Literal["wasserstein", "hinge"] = "wasserstein",
    clusters: int | None = None,
    predictor_steps: int = 100_000,
    predictor_images: int = 65_536,
    released: bool = False,
    mirror: bool = False,
    checkpoint_every: int = 500,
) -> Recipe:
    """Shapes from silhouettes with the paper's choices: a full 3-D generator, spectral norm, WGAN-GP, five rounds.

    Args:
        data: a folder of pictures, an .npz, or a 3-D collection; a family of chairs unless given.
        views: predicted, known, single or direct, as in `shapes`.
        size: voxels, and pixels, a side.
        bins: ways of looking: bins of azimuth.
        bands: times this many bands of elevation, 15° each, centred on the horizon; 1: all at elevation 0.
        looks_per_shape: silhouettes rendered of each shape of a 3-D collection.
        binary: cut rendered silhouettes at one half.
        steps: budget in generator steps; 300000 (five rounds of 60000) if neither steps nor minutes is given.
        minutes: budget in minutes of the clock.
        seed: of the weights, of every draw, and of the rendered silhouettes.
        batch: images an update.
        channels: of the generator's 4³ level.
        judge: channels of the discriminator's first level.
        loss: wasserstein (with gradient penalty) or hinge.
        clusters: discriminator heads by k-means of the predicted views; the released code uses 8.
        predictor_steps: of the view predictor, in each of four rounds.
        predictor_images: silhouettes of generated shapes that it is trained with, each round.
        released: the released code's camera (viewport 1.4), alpha rule and inference with batch statistics.
        mirror: generate half a volume and reflect it.
        checkpoint_every: steps between checkpoints.
    """
    silhouette = Silhouette(size=size, rule="alpha", viewport=1.4) if released else Silhouette(size=size)
    generator = partial(
        VoxelGenerator,
        size=size,
        channels=channels,
        mirror=mirror,
        upsampling="transposed" if released else "nearest",
        batch_statistics=released,
        truncation=0.75 if released else None,
    )
    adam = Adam(1e-4, beta1=0.5, beta2=0.999)
    return Recipe(
        generator=generator,
        discriminator=partial(Discriminator, channels=judge, spectral=True, slope=0.1, volumetric=views == "direct"),
        looks=look_at(data, views, ways_of_looking(silhouette, bins, bands), looks_per_shape, binary, seed),
        assignment=paper_assignment(views, predictor_steps, clusters, binarise=True, images=predictor_images),
        loss=Wasserstein() if loss == "wasserstein" else Hinge(),
        penalty=GradientPenalty(10.0) if loss == "wasserstein" else None,
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        discriminator_steps=2,
        batch=batch,
        steps=300_000 if steps is None and minutes is None else steps,
        minutes=minutes,
        seed=seed,
        checkpoint_every=checkpoint_every,
    )


def ways_of_looking(silhouette: Silhouette, bins: int, bands: int) -> tuple[Observation, ...]:
    """Bins of azimuth at elevation 0, or times bands of elevation."""
    if bins < 1 or bands < 1:
        raise UserError(f"bins={bins}, bands={bands}: give at least one of each")
    return azimuth_bins(bins, silhouette) if bands == 1 else azimuth_elevation_bins(bins, bands, silhouette)


def look_at(
    data: Path | None,
    views: Views,
    ways: tuple[Observation, ...],
    looks_per_shape: int,
    binary: bool,
    seed: int,
    flips: bool = False,
) -> Looks:
    """Pair observations with what `data` has to offer them."""
    silhouette = ways[0].projection
    assert isinstance(silhouette, Silhouette) and silhouette.size is not None
    size = silhouette.size
    collection = read_or_make(data, size)
    volumetric = collection.items.shape[1:] == (size, size, size)
    if views == "direct":
        if not volumetric:
            raise UserError(
                f"{collection.source}: direct training needs volumes; give a 3-D collection or other --views"
            )
    elif volumetric:
        where = derived_seed(seed, 0, "silhouettes")
        collection = observe(collection, ways, looks_per_shape, where, binary=binary)
    collection = with_flips(collection) if flips else collection
    return pair(views, ways, collection)


def read_or_make(data: Path | None, size: int) -> Collection:
    if data is None:
        return Collection(chairs(EMBEDDED_CHAIRS, size, seed=0))
    found = read(data, size=size)
    if found.items.dim() != 4:
        raise UserError(f"{data}: holds line integrals; shapes are learned from pictures or volumes")
    return found
