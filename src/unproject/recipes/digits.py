"""Images from line integrals: the recipe of the paper's Part III, and a modern one.

The arms of a comparison differ by `views`, and by what images of unknown directions need. `pairing` has the table.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import torch
from typing_extensions import Unpack

from .._random import derived_seed
from .._types import UserError
from ..adversarial.augmentation import Shift
from ..adversarial.losses import Relativistic, Wasserstein
from ..adversarial.penalties import R1R2, GradientPenalty
from ..assignment import Panel, Predicted
from ..data import Collection, observe, read
from ..data import digits as embedded_digits
from ..data.measured_lines import scale_of, standardised_lines
from ..networks import Discriminator, ImageGenerator, LineDiscriminator, SmoothImageGenerator
from ..projections.line_integral import LineIntegral, directions, opposite_directions
from ..training import Adam, Options, Recipe, Tries, resumable
from .pairing import Views, five_rounds, jointly_predicted, panel_of
from .precision import in_fast_precision
from .sizes import SMALL, images_sized_by_data

DIGITS_SPREAD = 2.5
"""Degrees, the paper's."""
ANCHOR_PENALTY, ANCHOR_WEIGHT = 10.0, 0.1
"""Factor of the gradient penalty of anchors, and their weight beside other lines: with 1 they pull all images to those
few that they are of."""
GAMMA_OF_LINES, GAMMA_OF_IMAGES = 0.3, 0.1
"""Weights of R1 and R2: with 0.02 lines give smears, with 1 many lines of known direction give images farther off."""
WIDTHS = {"known": 256}
"""Of the hidden layers of `LineDiscriminator`, where half as wide ones gave nearer images: they take more steps."""
SHIFTED = 16
"""Shifts go up to this part of the width: 2 of 32 pixels were better than 4."""


@images_sized_by_data
@partial(in_fast_precision, where=lambda arguments: arguments.get("views", "known") == "known")
@resumable
def digits(
    *,
    data: Path | None = None,
    views: Views = "known",
    size: int | None = None,
    bins: int = 10,
    spread: float | None = None,
    center: float | None = None,
    anchors: Path | None = None,
    views_per_image: int = 1,
    seed: int = 0,
    channels: int = 128,
    rate: float = 1e-3,
    gamma: float | None = None,
    shift: float | None = None,
    information: float = 0.0,
    rounds: int = 40,
    balance: float = 0.8,
    tries: int = 3,
    **options: Unpack[Options],
) -> Recipe:
    """Images from line integrals, for a laptop: a smooth generator, a fully connected discriminator, lazy R1 + R2.

    Args:
        data: an .npz of measured lines or sinograms; or a folder of pictures, an .npz or an idx file, of which only
            line integrals are used, except for direct training (default: handwritten digits).
        views: what is known of the directions: known, predicted (nothing; they are estimated image by image), learned
            (nothing; only their distribution is estimated), single (nothing; one discriminator head), or direct (no
            projection: train on the images themselves).
        size: pixels a side, and detectors where lines are taken of images (default: 32; of measured lines 8, 16, 32 or
            64, whichever is nearest to their detectors).
        bins: directions, evenly over half a turn.
        spread: each direction is uniform within ± so many degrees (default: 2.5; of measured lines 90 / `bins`, which
            leaves no gap).
        center: of measured lines, the detector, counted from 0, that the axis of rotation projects to (default: the
            middle, (D - 1) / 2; scikit-image's is D // 2).
        anchors: an .npz of a few more lines with their angles; they are to fix how generated images are
            turned and mirrored, which lines alone leave open. Experimental: 50 were too few for MNIST.
        views_per_image: line integrals taken of each image.
        seed: of the weights, of every draw, and of the line integrals taken.
        channels: of the generator's 4² level.
        rate: learning rate at the start; it falls to a tenth along a cosine.
        gamma: weight of R1 and R2, in units of the readings' deviation (default: 0.3 of lines, 0.1 of images).
        shift: shift all that the discriminator sees by up to so many pixels (default: a sixteenth of the width of
            images, of lines 0).
        information: weight of a preference for images whose directions can be predicted (`JointlyPredicted`), which has
            not been found to help.
        rounds: how often directions are predicted anew, evenly over the budget.
        balance: how far the distribution of predicted directions is moved to the uniform one, 0 to 1, while lines hold
            no information of them; the more they hold, the less, down to a quarter of it.
        tries: short starts, if directions are predicted; the one whose lines tell most of theirs goes on.
        options: fields of `Recipe`.
    """
    adam = Adam(rate, beta1=0.0, beta2=0.95, final=rate / 10)
    predicted = jointly_predicted(rounds, balance, information, opposite_directions(bins), window=bins)
    size = SMALL if size is None else size
    scan = Scan(size, bins, spread, views_per_image, center)
    source = source_of(data, views, scan)
    panel = line_panel(source, views, scan, seed, predicted, whole=True)
    direct = views == "direct"
    mean, deviation = readings(panel)
    unknown = views not in ("known", "direct")
    gamma = (GAMMA_OF_IMAGES if direct else GAMMA_OF_LINES) if gamma is None else gamma
    shift = (size / SHIFTED if direct else 0.0) if shift is None else shift
    return Recipe(
        generator=partial(SmoothImageGenerator, size=size, channels=channels, **({"disc": True} if unknown else {})),
        discriminator=partial(Discriminator, channels=32, bottleneck=256)
        if direct
        else partial(LineDiscriminator, mean=mean, deviation=deviation, width=WIDTHS.get(views, 512)),
        panels=[panel, *([anchor_panel(anchors, source, views, scan)] if anchors else [])],
        loss=Relativistic(),
        penalty=R1R2(gamma * deviation**2, every=8),
        augmentation=Shift(shift) if shift else None,
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        batch=64 if direct else 128,
        views_per_sample=1 if direct else 4,
        steps=6000,
        seed=seed,
        tries=Tries(tries) if views == "predicted" else None,
    ).configured(options)


@images_sized_by_data
@resumable
def digits_paper(
    *,
    data: Path | None = None,
    views: Views = "known",
    size: int | None = None,
    bins: int = 10,
    spread: float | None = None,
    center: float | None = None,
    views_per_image: int = 1,
    seed: int = 0,
    channels: int = 512,
    discriminator_channels: int = 64,
    clusters: int | None = None,
    predictor_steps: int = 100_000,
    predictor_images: int = 65_536,
    **options: Unpack[Options],
) -> Recipe:
    """Images from line integrals with the choices of the paper's Part I: spectral norm, WGAN-GP, five rounds.

    The paper names no networks for Part III; these are those of its shapes, one dimension lower.

    Args:
        data: measured lines or pictures, as in `digits` (default: handwritten digits).
        views: known, predicted, learned, single or direct, as in `digits`.
        size: pixels a side, and detectors where lines are taken of images (default: 32; of measured lines 8, 16, 32 or
            64, whichever is nearest to their detectors).
        bins: directions, evenly over half a turn.
        spread: each direction is uniform within ± so many degrees (default: 2.5; of measured lines 90 / `bins`, which
            leaves no gap).
        center: of measured lines, the detector, counted from 0, that the axis of rotation projects to (default: the
            middle, (D - 1) / 2; scikit-image's is D // 2).
        views_per_image: line integrals taken of each image.
        seed: of the weights, of every draw, and of the line integrals taken.
        channels: of the generator's 4² level.
        discriminator_channels: of the discriminator's first level.
        clusters: discriminator heads by k-means of the predicted directions (default: one head a direction).
        predictor_steps: of the view predictor, in each of four rounds.
        predictor_images: line integrals of generated images that it is fitted to, each round.
        options: fields of `Recipe`.
    """
    adam = Adam(1e-4, beta1=0.5, beta2=0.999)
    predicted = five_rounds(predictor_steps, predictor_images, clusters)
    size = SMALL if size is None else size
    scan = Scan(size, bins, spread, views_per_image, center)
    return Recipe(
        generator=partial(ImageGenerator, size=size, channels=channels),
        discriminator=partial(Discriminator, channels=discriminator_channels, spectral=True, slope=0.1),
        panels=[line_panel(source_of(data, views, scan), views, scan, seed, predicted)],
        loss=Wasserstein(),
        penalty=GradientPenalty(10.0),
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        discriminator_steps=2,
        batch=64,
        steps=100_000,
        seed=seed,
    ).configured(options)


class Scan(NamedTuple):
    """How line integrals are taken: pixels a side, directions, ± degrees within each, lines an image, axis."""

    size: int
    bins: int
    spread: float | None
    views_per_image: int
    center: float | None = None


class Source(NamedTuple):
    """What `data` holds: images, or lines that were measured, as `line_integral` makes them, in its unit."""

    collection: Collection
    line_integral: LineIntegral
    measured: bool


def source_of(data: Path | None, views: Views, scan: Scan) -> Source:
    """Read images or measured lines.

    Raises:
        UserError: for volumes, or what does not go with the rest.
    """
    found = Collection(embedded_digits(scan.size)) if data is None else read(data, scan.size, pictures="images")
    if found.shape[0] != 1:
        raise UserError(f"{data}: holds volumes; images are learned from pictures or line integrals")
    if len(found.shape) == 2:
        if views == "direct":
            raise UserError(f"{data}: direct training needs images, and this holds line integrals; use other --views")
        scale = scale_of(found)
        found = standardised_lines(found, scan.bins, scale, scan.center)
        return Source(found, LineIntegral(found.shape[1], unit=scale, center=scan.center), True)
    if scan.center is not None:
        raise UserError(f"{data or 'digits'}: center={scan.center:g} is of measured lines; leave it out for images")
    return Source(found, LineIntegral(scan.size), False)


def line_panel(source: Source, views: Views, scan: Scan, seed: int, predicted: Predicted, whole: bool = False) -> Panel:
    """Return the panel of line integrals of images, or of measured lines.

    With `whole`, unknown directions may lie anywhere around. If they were confined to one half of a turn, images that
    are turned would need lines read from the other end, and could never come right.
    """
    found, seen = source.collection, partial(directions, scan.bins, spread_of(scan, source), source.line_integral)
    if views != "direct" and not source.measured:
        where = derived_seed(seed, 0, "line integrals")
        found = observe(found, seen(), scan.views_per_image, where, chunk=4096)
    observations = seen(whole=whole and views in ("predicted", "learned"))
    return panel_of(views, observations, found, predicted)


def anchor_panel(anchors: Path, source: Source, views: Views, scan: Scan) -> Panel:
    """Return the panel of a few lines of known direction, to which generated images turn.

    Its discriminator would know so few lines by heart, so their gradient penalty is larger.

    Raises:
        UserError: if no direction is unknown, or the lines do not go with the others.
    """
    if views in ("known", "direct"):
        raise UserError(
            f"{anchors}: anchors stand beside lines of unknown direction; leave them out with {views} views"
        )
    found = standardised_lines(Collection.lines(anchors), scan.bins, source.line_integral.unit, scan.center)
    if found.shape[1] != source.line_integral.bins:
        raise UserError(f"{anchors}: has lines of {found.shape[1]} detectors, not {source.line_integral.bins}")
    panel = panel_of("known", directions(scan.bins, spread_of(scan, source), source.line_integral), found)
    return replace(panel, penalty_scale=ANCHOR_PENALTY, weight=ANCHOR_WEIGHT)


def spread_of(scan: Scan, source: Source) -> float:
    """Return half the width of each direction, radians: of measured lines nobody says that some angles are missing."""
    if scan.spread is None and source.measured:
        return math.pi / 2 / max(scan.bins, 1)
    return math.radians(DIGITS_SPREAD if scan.spread is None else scan.spread)


def readings(panel: Panel) -> tuple[float, float]:
    """Return mean and deviation of a panel's images, to three digits: the last ones depend on the number of threads."""
    values = torch.cat([collection.floats().flatten() for collection in panel.collections])
    return float(f"{values.mean():.3g}"), float(f"{values.std().clamp_min(1e-6):.3g}")
