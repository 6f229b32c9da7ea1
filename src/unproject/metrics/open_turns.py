"""Scores of images up to the turn of each: what line integrals of unknown direction leave open, image by image.

With T_t and F of `metrics.gauge`, K = 2n and n directions k = 0 ... n - 1 over half a turn, M = T_1 F is the reflection
about the middle of the directions: P(M x, k) = P(x, n - 1 - k). Any images of a set may be replaced by M x and no
line changes but for its unknown label: the true set with half of its images mirrored explains the same lines. Turned by
other steps, an image has most of its lines, read from the other end.

A fair score turns each image of both sets, generated and reference, by a random element of the group, and compares what
comes out, on features of a classifier that was trained on digits turned and mirrored at random.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError
from ..ops.turning import turn_image
from .digit_classifier import BATCH, FEATURES, TURNED, digit_features
from .feature_sets import frechet_distance, precision_recall
from .gauge import Gauge, dihedral
from .score import Score
from .shape_scores import drawn

MAX_COMPARED = 5000


def open_gauges(directions: int) -> tuple[Gauge, ...]:
    """Return the gauges that take each of `directions` directions over half a turn to one of them: 1 and M.

    Examples:
        >>> [str(gauge) for gauge in open_gauges(10)]
        ['turn 0/20', 'turn 1/20, reflected']
    """
    k = torch.arange(directions)
    return tuple(gauge for gauge in dihedral(2 * directions) if bool((gauge.view(k) < directions).all()))


def randomly_turned(images: Tensor, gauges: Sequence[Gauge], seed: int) -> Tensor:
    """Apply to each image (N, C, H, H) one of the gauges, drawn at random; without blur (`ops.turn_image`)."""
    chosen = torch.randint(len(gauges), (len(images),), generator=generator_at(seed, 0, "turns"))
    angle = torch.tensor([-gauge.azimuth for gauge in gauges])[chosen]
    reflected = torch.tensor([gauge.reflected for gauge in gauges])[chosen]
    parts = zip(images.split(BATCH), angle.split(BATCH), reflected.split(BATCH), strict=True)
    return torch.cat([turn_image(*part) for part in parts])


@torch.no_grad()
def turned_scores(generated: Tensor, reference: Tensor, directions: int = 10, seed: int = 0) -> dict[str, Score]:
    """Score images of digits up to the turn of each.

    Args:
        generated: (G, 1, H, H) in [0, 1], white on black.
        reference: (R, 1, H, H).
        directions: over half a turn, of the lines.
        seed: of the turns.

    Returns:
        `frechet_`, `precision_` and `recall_` + `mirrored` (each image as it is or as M x) or `turned` (by any multiple
        of half a turn / directions, mirrored or not).

    Raises:
        UserError: for images that are not square, or fewer than six.

    Examples:
        >>> import torch, unproject as up
        >>> digits = up.data.digits(32)[:64]
        >>> scores = up.metrics.turned_scores(digits, digits)
        >>> sorted(scores)[:2]
        ['frechet_mirrored', 'frechet_turned']
    """
    if generated.shape[2] != generated.shape[3] or min(len(generated), len(reference)) < 6:
        raise UserError(
            f"turned scores: give at least six square images a set, not {tuple(generated.shape)} and "
            f"{tuple(reference.shape)}"
        )
    scores = {}
    groups = {"mirrored": open_gauges(directions), "turned": dihedral(2 * directions)}
    for name, gauges in groups.items():
        x, y = (
            digit_features(randomly_turned(images, gauges, 2 * seed + i), TURNED)[0]
            for i, images in enumerate((generated, reference))
        )
        least = min(len(x), len(y), MAX_COMPARED)
        precision, recall = precision_recall(x[drawn(len(x), least, seed)], y[drawn(len(y), least, seed)])
        how = f"each image of both sets after one of {len(gauges)} turns at random"
        what = f"{FEATURES} features of the classifier of turned digits, {{}} generated vs {{}} reference, {how}"
        equal, balls = what.format(least, least), "balls to the 3rd neighbour"
        whole = what.format(len(x), len(y))
        scores[f"frechet_{name}"] = Score(frechet_distance(x, y), f"Fréchet distance, {whole}", len(x), seed)
        scores[f"precision_{name}"] = Score(precision, f"precision, {balls}, {equal}", least, seed)
        scores[f"recall_{name}"] = Score(recall, f"recall, {balls}, {equal}", least, seed)
    return scores
