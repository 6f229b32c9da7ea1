"""Shapes from silhouettes: the recipes of the paper's Part I, and modern ones.

The arms of a comparison differ by `views`, and by preferences that only unknown views have; `pairing` has the table.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Literal

from typing_extensions import Unpack

from ..adversarial.adaptive import Adaptive
from ..adversarial.augmentation import Affine
from ..adversarial.losses import Hinge, Wasserstein
from ..adversarial.penalties import R1R2, GradientPenalty
from ..networks import Discriminator, VoxelGenerator
from ..projections.silhouette import Silhouette
from ..training import Adam, Options, Recipe, Tries, resumable
from .coarse import from_half_size
from .pairing import Views, five_rounds, jointly_predicted, panel_of
from .precision import in_fast_precision
from .shape_panels import (
    Weights,
    falling_adams,
    mirror_of,
    mirrored_by,
    networks_of,
    pictures_of,
    preferences,
    silhouette_views,
    silhouettes_of,
    split_panel,
)
from .sizes import STEPS, check_size_of_shapes, shapes_sized_by_data


@shapes_sized_by_data
@in_fast_precision
@resumable
def shapes(
    *,
    data: Path | None = None,
    views: Views = "predicted",
    size: int | None = None,
    bins: int = 16,
    bands: int | None = None,
    views_per_shape: int = 16,
    binary: bool = False,
    flips: bool = False,
    augment: bool = True,
    seed: int = 0,
    channels: int = 128,
    rank: int = 32,
    density: float = 2.0,
    rate: float = 1.5e-3,
    gamma: float = 0.1,
    solid: float = 0.1,
    rectilinear: float = 1.0,
    varied: float = 0.1,
    connected: float = 3.0,
    inflated: float = 10.0,
    axisymmetric: float | None = None,
    information: float = 0.0,
    rounds: int = 40,
    balance: float = 0.8,
    anywhere: float = 0.0,
    init_views: bool = False,
    tries: int = 3,
    mirror: bool = True,
    coarse_to_fine: bool = True,
    **options: Unpack[Options],
) -> Recipe:
    """Shapes from silhouettes, for a laptop: low-rank generator, relativistic loss with lazy R1 + R2.

    Args:
        data: a folder of pictures, an .npz, or a 3-D collection (default: procedural chairs).
        views: what is known of the views: predicted (nothing; they are estimated image by image), learned (nothing;
            only their distribution is estimated), known, single (nothing; one discriminator head), or direct (no
            projection: train on the volumes themselves).
        size: voxels, and pixels, a side (default: 64 if the pictures or volumes of `data` are at least 64 a side, in a
            folder the median of their shorter sides; 32 of smaller ones, of a folder of fewer than 1,000 pictures, with
            views direct, and if `minutes` is under 30).
        bins: views: bins of azimuth.
        bands: bands of elevation of 15 degrees each, centred on the horizon (1: all at elevation 0). By default
            elevations are 0, except of pictures of unknown view that were not cropped, unless outlines show that
            cameras were level (`ops.level_share`): these are learned along.
        views_per_shape: silhouettes rendered of each shape of a 3-D collection.
        binary: threshold rendered silhouettes at one half.
        flips: learn from the mirror images of the pictures too; for small collections.
        augment: hold a tenth of the pictures out, and when discriminators learn the others by heart, shift, zoom and
            roll what they see, and raise their penalty up to tenfold (`Adaptive`).
        seed: of the weights, of every draw, and of the rendered silhouettes.
        channels: width of the generator.
        rank: plane-line products an axis.
        density: a full voxel absorbs 1 - exp(-density).
        rate: learning rate at the start; it falls to a tenth along a cosine.
        gamma: weight of R1 and R2.
        solid: weight of the preference for full volumes at the start; it falls to a tenth linearly.
        rectilinear: weight at the start of the preference for shapes that are rectangles from above, if views are not
            known; it falls to 0.3 of it early. Of solutions that fit the pictures equally well it prefers simple plans.
        varied: weight of the preference for shapes that differ in their proportions, if views are not known, after a
            fifth of the budget. If wide and narrow pictures may be different objects or two sides of one, it
            prefers different objects.
        connected: weight of the preference for shapes in one piece.
        inflated: weight of the preference for shapes that are as thick across their plane of symmetry as they look
            wide, but need not be thicker than the narrowest pictures are wide, if views are not known and `mirror` is
            on. Pictures of one side do not tell, and boards match them.
        axisymmetric: weight of the preference for bodies of revolution, in place of those for rectangles, different
            proportions and thickness, if views are not known (default: 6 if most pictures of a folder or an
            array show a round foot, as `ops.round_feet` tells of cameras above the horizon; else 0).
        information: weight of a preference for shapes whose views can be predicted (`JointlyPredicted`), which has not
            been found to help.
        rounds: how often views are predicted anew, evenly over the budget.
        balance: how far the distribution of predicted views is moved to the uniform one, 0 to 1, while pictures hold no
            information of their views; the more they hold, the less, down to a quarter of it.
        anywhere: share of the pictures, others each round, that are compared with samples seen from anywhere, views
            evenly, so that shapes look like some picture also from sides that few pictures show. Of photographs of
            one side 0.25 made chairs where there were boards, but heaps of plates of seats of many kinds.
        init_views: initialise predicted views by those of one mean shape, fitted to all silhouettes, instead of random
            ones, as some arms of the figures do (docs/reproduction.md).
        tries: short starts, if views are predicted; the one whose pictures tell most of their views goes on.
        mirror: shapes are symmetric about the plane x = 0; with known views or volumes about x = 0 or z = 0 if these
            are (`data.plane_of_symmetry`). Turn it off for asymmetric ones.
        coarse_to_fine: from 64 voxels a side on, learn shapes of half the size first, for 0.8 of the budget, in
            OUT/coarse, and go on with what they came to (not with views direct, nor if `channels` are over eight times
            `rank` at 64).
        options: fields of `Recipe`.
    """
    given, found = locals(), pictures_of(data, views, size, density, bins, bands, views_per_shape, binary, seed)
    plane, level = mirror_of(mirror, views, found.collection), views != "direct" and bands in (None, 1)
    how = jointly_predicted(rounds, balance, information, mirrored_by(plane, bins, bands), init_views, anywhere)
    panel = split_panel(views, bands, found.observations, found.collection, how, seed if augment else None, flips)
    weights = Weights(solid, rectilinear, varied, connected, inflated, axisymmetric)
    recipe = Recipe(
        **networks_of(panel, channels, rank, plane, density if level else False, direct=views == "direct"),
        panels=[panel],
        penalty=R1R2(gamma, every=8),
        augmentation=None if panel.held_out is None else Adaptive(Affine(), penalty=10.0),
        regulariser=preferences(views, weights, found, bands, plane),
        **falling_adams(rate),
        steps=STEPS,
        seed=seed,
        tries=Tries(tries) if views == "predicted" else None,
    ).configured({"batch": 48, "views_per_sample": 1 if views == "direct" else 2, **options})
    return from_half_size(recipe, shapes, given) if coarse_to_fine else recipe


@resumable
def shapes_paper(
    *,
    data: Path | None = None,
    views: Views = "predicted",
    size: int = 64,
    bins: int = 16,
    bands: int = 1,
    views_per_shape: int = 16,
    binary: bool = False,
    seed: int = 0,
    channels: int = 512,
    discriminator_channels: int = 64,
    loss: Literal["wasserstein", "hinge"] = "wasserstein",
    clusters: int | None = None,
    predictor_steps: int = 100_000,
    predictor_images: int = 65_536,
    released: bool = False,
    mirror: bool = False,
    **options: Unpack[Options],
) -> Recipe:
    """Shapes from silhouettes with the paper's choices: a full 3-D generator, spectral norm, WGAN-GP, five rounds.

    Args:
        data: a folder of pictures, an .npz, or a 3-D collection (default: procedural chairs).
        views: predicted, learned, known, single or direct, as in `shapes`.
        size: voxels, and pixels, a side.
        bins: views: bins of azimuth.
        bands: bands of elevation of 15 degrees each, centred on the horizon (1: all at elevation 0).
        views_per_shape: silhouettes rendered of each shape of a 3-D collection.
        binary: threshold rendered silhouettes at one half, as the paper's are.
        seed: of the weights, of every draw, and of the rendered silhouettes.
        channels: of the generator's 4³ level.
        discriminator_channels: of the discriminator's first level.
        loss: wasserstein (with gradient penalty) or hinge.
        clusters: discriminator heads by k-means of the predicted views, of which the released code has 8 (default: one
            head a view).
        predictor_steps: of the view predictor, in each of four rounds.
        predictor_images: silhouettes of generated shapes that it is fitted to, each round.
        released: the released code's camera (viewport 1.4), alpha rule and inference with batch statistics.
        mirror: generate half a volume and reflect it.
        options: fields of `Recipe`.
    """
    check_size_of_shapes(size)
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
    observations = silhouette_views(silhouette, bins, bands)
    collection = silhouettes_of(data, views, observations, views_per_shape, binary, seed)
    predicted = five_rounds(predictor_steps, predictor_images, clusters, binarise=True)
    return Recipe(
        generator=generator,
        discriminator=partial(
            Discriminator, channels=discriminator_channels, spectral=True, slope=0.1, volumetric=views == "direct"
        ),
        panels=[panel_of(views, observations, collection, predicted)],
        loss=Wasserstein() if loss == "wasserstein" else Hinge(),
        penalty=GradientPenalty(10.0) if loss == "wasserstein" else None,
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        discriminator_steps=2,
        batch=32,
        steps=300_000,
        seed=seed,
    ).configured(options)
