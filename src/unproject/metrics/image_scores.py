"""Distances between generated and held-out images: of digits on features of the digit classifier, of any by pixels."""

from __future__ import annotations

import torch
from torch import Tensor

from .._types import UserError
from .digit_classifier import CLASSES, FEATURES, digit_features
from .feature_sets import density_coverage, frechet_distance, kernel_distance, precision_recall
from .gauge import Gauge, apply_to_images, dihedral
from .picture_sets import root_mean_square
from .score import Score
from .shape_scores import drawn, set_scores

SELECTION, MOST = 1000, 5000


@torch.no_grad()
def image_scores(
    generated: Tensor,
    reference: Tensor,
    *,
    selection: Tensor | None = None,
    bins: int | None = None,
    seed: int = 0,
) -> dict[str, Score]:
    """Score generated images of digits, white on black, against reference images.

    Args:
        generated: (G, 1, H, W) in [0, 1].
        reference: (R, 1, H, W), upright.
        selection: other images of the reference's distribution, on which the gauge is chosen (default: the references,
            which biases the scores a little; the protocol names it). At most 1000 are used, and at most 1000 generated.
        bins: the gauge's rotations are multiples of 2π / bins (default: no gauge).
        seed: of the subsets drawn from larger sets.

    Returns:
        `frechet`, `kernel_image`, `precision`, `recall`, `density`, `coverage`; `class_distance`, half the sum of
        the differences between the sets' shares of digits, and `class_0` to `class_9`, the generated set's shares;
        and, unless bins is None, `gauge_turn` and `gauge_reflected`, which were applied to the generated set.

    Raises:
        UserError: for sets of fewer than six images, images of different sizes, or NaN.

    Examples:
        >>> import torch, unproject as up
        >>> images = torch.rand(8, 1, 32, 32, generator=torch.Generator().manual_seed(0))
        >>> scores = up.metrics.image_scores(images, images)
        >>> scores["precision"].value, scores["precision"].n
        (1.0, 8)
    """
    if generated.shape[1:] != reference.shape[1:] or min(len(generated), len(reference)) < 6:
        raise UserError(
            f"image scores: give at least six images of one size a set, not {tuple(generated.shape)} and "
            f"{tuple(reference.shape)}"
        )
    chosen, gauge = "gauge as it stands", None
    if bins is not None:
        others, whose = (reference, "the references") if selection is None else (selection, "other images")
        some, chosen_on = (items[drawn(len(items), SELECTION, seed)] for items in (generated, others))
        gauge = best_image_gauge(some, chosen_on, bins)
        sizes = f"{len(some)} generated to {len(chosen_on)} of {whose}"
        chosen = f"best of {2 * bins} dihedral gauges by the Fréchet distance of {sizes}"
        generated = apply_to_images(generated, gauge)
    scores = _feature_scores(digit_features(generated), digit_features(reference), chosen, seed)
    if gauge is None:
        return scores
    turn = f"clockwise turn applied to the generated set, in 1/{bins} of a turn, {chosen}"
    reflected = f"1 if left and right of the generated set were exchanged before the turn, {chosen}"
    return scores | {
        "gauge_turn": Score(float(gauge.turn), turn, len(generated), seed),
        "gauge_reflected": Score(float(gauge.reflected), reflected, len(generated), seed),
    }


@torch.no_grad()
def pixel_scores(generated: Tensor, reference: Tensor, *, seed: int = 0) -> dict[str, Score]:
    """Score generated images (G, C, H, W) of anything against reference images by the distance of their pixels.

    The distance of two images is the root of their mean squared difference. At most 5000 of each set are compared.

    Returns:
        `mmd_rms`, `cov_rms`, `1nna_rms`: see `shape_sets`. MMD prefers blurred images, as any mean of squares does.

    Raises:
        UserError: for images of different sizes, no image, or NaN.

    Examples:
        >>> import unproject as up
        >>> digits = up.data.digits(32)
        >>> scores = up.metrics.pixel_scores(digits[:64], digits[64:128])
        >>> sorted(scores)
        ['1nna_rms', 'cov_rms', 'mmd_rms']
    """
    if generated.shape[1:] != reference.shape[1:] or not (len(generated) and len(reference)):
        raise UserError(
            f"pixel scores: give images of one size, not {tuple(generated.shape)} and {tuple(reference.shape)}"
        )
    if not bool(torch.isfinite(generated).all() and torch.isfinite(reference).all()):
        raise UserError("pixel scores: the images have NaN or infinite values; fix or leave out those images")
    x, y = (images[drawn(len(images), MOST, seed)].flatten(1).float() for images in (generated, reference))
    setting = "root mean square difference of pixels), {} generated vs {} reference"
    found = set_scores("rms", root_mean_square, x, y, setting, seed)
    return {name: score for name, score in found.items() if not name.endswith("_equal")}


def best_image_gauge(generated: Tensor, reference: Tensor, bins: int) -> Gauge:
    """Return the gauge g with the least Fréchet distance of (g · generated, reference), one for the whole set."""
    wanted, _ = digit_features(reference)

    def distance(gauge: Gauge) -> float:
        return frechet_distance(digit_features(apply_to_images(generated, gauge))[0], wanted)

    return min(dihedral(bins), key=distance)


def _feature_scores(
    generated: tuple[Tensor, Tensor], reference: tuple[Tensor, Tensor], chosen: str, seed: int
) -> dict[str, Score]:
    (x, digits), (y, true) = generated, reference
    n = len(x)
    least = min(n, len(y), MOST)
    balls = x[drawn(n, least, seed)], y[drawn(len(y), least, seed)]
    precision, recall = precision_recall(*balls)
    density, coverage = density_coverage(*balls)
    where = f"{FEATURES} features of the digit classifier, {{}} generated vs {{}} reference, {chosen}"
    whole, equal = where.format(n, len(y)), where.format(least, least)
    shares, wanted = (torch.bincount(found, minlength=CLASSES).double() / len(found) for found in (digits, true))
    scores = {
        "frechet": Score(frechet_distance(x, y), f"Fréchet distance, {whole}", n, seed),
        "kernel_image": Score(kernel_distance(x, y), f"unbiased cubic-kernel mmd^2, {whole}", n, seed),
        "precision": Score(precision, f"precision, balls to the 3rd neighbour, {equal}", least, seed),
        "recall": Score(recall, f"recall, balls to the 3rd neighbour, {equal}", least, seed),
        "density": Score(density, f"density, balls to the 5th neighbour, {equal}", least, seed),
        "coverage": Score(coverage, f"coverage, balls to the 5th neighbour, {equal}", least, seed),
    }
    distance = (shares - wanted).abs().sum().item() / 2
    scores["class_distance"] = Score(distance, f"total variation of the shares of digits, {whole}", n, seed)
    share = f"share of the generated images that the digit classifier calls this, {chosen}"
    return scores | {f"class_{k}": Score(shares[k].item(), share, n, seed) for k in range(CLASSES)}
