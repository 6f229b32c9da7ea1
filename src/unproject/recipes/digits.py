"""Images from line integrals: the recipe of the paper's Part III, and a modern one.

The four arms of every comparison differ by `views` alone; `pairing` has the table.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch

from .._random import derived_seed
from .._types import UserError
from ..adversarial.assignment import Predicted
from ..adversarial.augmentation import Shift
from ..adversarial.gaussian_start import GaussianStart
from ..adversarial.losses import Relativistic, Wasserstein
from ..adversarial.penalties import R1R2, GradientPenalty
from ..data import Collection, observe, read
from ..data import digits as embedded_digits
from ..networks import Discriminator, ImageGenerator, LineDiscriminator, SmoothImageGenerator
from ..projections.line_integral import LineIntegral, directions
from ..training.recipe import Adam, Looks, Recipe
from .pairing import Views, little_and_often, modern_assignment, pair, paper_assignment


def digits(
    *,
    data: Path | None = None,
    views: Views = "known",
    size: int = 32,
    bins: int = 10,
    spread: float = 2.5,
    looks_per_image: int = 1,
    steps: int | None = None,
    minutes: float | None = None,
    seed: int = 0,
    batch: int | None = None,
    looks_each: int = 4,
    channels: int = 128,
    rate: float = 1e-3,
    gamma: float | None = None,
    shift: float = 0.0,
    rounds: int = 15,
    balance: float = 0.8,
    checkpoint_every: int = 500,
) -> Recipe:
    """Images from line integrals, made for a laptop: a DCGAN, a fully connected discriminator, lazy R1 + R2.

    Args:
        data: a folder of pictures, an .npz or an idx file; real handwritten digits unless given. Their line
            integrals are taken, and nothing else of them is used, except for direct training.
        views: what is known of the directions: known, predicted (nothing, but estimated image by image), learned
            (nothing, but how often each was taken is estimated), single (nothing, one discriminator head), or
            direct (no projection: train on the images themselves).
        size: pixels a side, and detectors.
        bins: directions, evenly over half a turn.
        spread: each direction is uniform within ± so many degrees.
        looks_per_image: line integrals taken of each image.
        steps: budget in steps; 6000 if neither steps nor minutes is given.
        minutes: budget in minutes of the clock.
        seed: of the weights, of every draw, and of the line integrals taken.
        batch: looks an update; 128, or 64 images for direct training, unless given.
        looks_each: line integrals an update of each generated image.
        channels: of the generator's 4² level.
        rate: learning rate at the start; it falls to a tenth along a cosine.
        gamma: weight of R1 and R2, in units of the readings' deviation; 0.02, or 0.1 for direct training.
        shift: shift all that the discriminator sees by up to so many pixels; for small collections (2).
        rounds: how often directions are predicted anew, evenly over the budget.
        balance: how far predicted directions are drawn to equal numbers from everywhere, 0 to 1.
        checkpoint_every: steps between checkpoints.
    """
    adam = Adam(rate, beta1=0.0, beta2=0.95, final=rate / 10)
    looks = look_through(data, views, size, bins, spread, looks_per_image, seed, whole=True)
    direct = views == "direct"
    mean, deviation = readings(looks)
    gamma = (0.1 if direct else 0.02) if gamma is None else gamma
    return Recipe(
        generator=partial(SmoothImageGenerator, size=size, channels=channels),
        discriminator=partial(Discriminator, channels=32, bottleneck=256)
        if direct
        else partial(LineDiscriminator, mean=mean, deviation=deviation),
        looks=looks,
        assignment=modern_assignment(views, from_a_guess(rounds, balance, bins)),
        loss=Relativistic(),
        penalty=R1R2(gamma * deviation**2, every=8),
        augmentation=Shift(shift) if shift else None,
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        batch=batch or (64 if direct else 128),
        looks_each=1 if direct else looks_each,
        steps=6000 if steps is None and minutes is None else steps,
        minutes=minutes,
        seed=seed,
        checkpoint_every=checkpoint_every,
    )


def digits_paper(
    *,
    data: Path | None = None,
    views: Views = "known",
    size: int = 32,
    bins: int = 10,
    spread: float = 2.5,
    looks_per_image: int = 1,
    steps: int | None = None,
    minutes: float | None = None,
    seed: int = 0,
    batch: int = 64,
    channels: int = 512,
    judge: int = 64,
    clusters: int | None = None,
    predictor_steps: int = 100_000,
    predictor_images: int = 65_536,
    checkpoint_every: int = 500,
) -> Recipe:
    """Images from line integrals with the choices of the paper's Part I: spectral norm, WGAN-GP, five rounds.

    The paper names no networks for Part III; these are those of its shapes, one dimension lower.

    Args:
        data: a folder of pictures, an .npz or an idx file; real handwritten digits unless given.
        views: known, predicted, learned, single or direct, as in `digits`.
        size: pixels a side, and detectors.
        bins: directions, evenly over half a turn.
        spread: each direction is uniform within ± so many degrees.
        looks_per_image: line integrals taken of each image.
        steps: budget in generator steps; 100000 if neither steps nor minutes is given.
        minutes: budget in minutes of the clock.
        seed: of the weights, of every draw, and of the line integrals taken.
        batch: line integrals an update.
        channels: of the generator's 4² level.
        judge: channels of the discriminator's first level.
        clusters: discriminator heads by k-means of the predicted directions.
        predictor_steps: of the view predictor, in each of four rounds.
        predictor_images: line integrals of generated images that it is trained with, each round.
        checkpoint_every: steps between checkpoints.
    """
    adam = Adam(1e-4, beta1=0.5, beta2=0.999)
    return Recipe(
        generator=partial(ImageGenerator, size=size, channels=channels),
        discriminator=partial(Discriminator, channels=judge, spectral=True, slope=0.1),
        looks=look_through(data, views, size, bins, spread, looks_per_image, seed),
        assignment=paper_assignment(views, predictor_steps, clusters, images=predictor_images),
        loss=Wasserstein(),
        penalty=GradientPenalty(10.0),
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        discriminator_steps=2,
        batch=batch,
        steps=100_000 if steps is None and minutes is None else steps,
        minutes=minutes,
        seed=seed,
        checkpoint_every=checkpoint_every,
    )


def from_a_guess(rounds: int, balance: float, bins: int) -> Predicted:
    """Directions of lines somewhere in half a turn of `bins`: from the Gaussian's guess, in fewer and longer rounds.

    Nothing in a short round brings images that are turned against one another together again, and a predictor that is
    trained in haste loses what the guess had right.
    """
    often = little_and_often(rounds, balance, start=0.15)
    return replace(often, images=8192, steps=150, window=bins, first=GaussianStart())


def look_through(
    data: Path | None,
    views: Views,
    size: int,
    bins: int,
    spread: float,
    looks_per_image: int,
    seed: int,
    whole: bool = False,
) -> Looks:
    """Pair directions, in degrees, with the line integrals of the images of `data`, or those that it holds.

    With `whole`, unknown directions may lie anywhere around. Where they are confined to one half of a turn, images
    that are turned ask for lines read from the other end, and what was learned turned never comes right.
    """
    found = Collection(embedded_digits(size)) if data is None else read(data, size, pictures="images")
    if found.shape[0] != 1:
        raise UserError(f"{data}: holds volumes; images are learned from pictures or line integrals")
    measured = found.items.dim() == 3
    line_integral = LineIntegral(found.items.shape[2] if measured else size)
    ways = directions(bins, math.radians(spread), line_integral)
    if views == "direct" and measured:
        raise UserError(f"{data}: direct training needs images, and this holds line integrals; use other --views")
    if views != "direct" and not measured:
        where = derived_seed(seed, 0, "line integrals")
        found = observe(found, ways, looks_per_image, where, chunk=4096)
    if whole and views in ("predicted", "learned"):
        ways = directions(bins, math.radians(spread), line_integral, whole=True)
    return pair(views, ways, found)


def readings(looks: Looks) -> tuple[float, float]:
    """Mean and deviation of what was seen, to three digits: the last ones depend on the number of threads."""
    collections = {id(collection): collection.floats() for _, collection in looks}
    seen = torch.cat([items.flatten() for items in collections.values()])
    return float(f"{seen.mean():.3g}"), float(f"{seen.std().clamp_min(1e-6):.3g}")
