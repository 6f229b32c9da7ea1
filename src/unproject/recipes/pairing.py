"""The panel of a set of views: what differs between the arms of a comparison.

=========== ==================================== ================================================
views       data                                 assignment
=========== ==================================== ================================================
predicted   one unlabelled collection            `Predicted` (VP-MP-GAN), or as the recipe says
learned     one unlabelled collection            `LearnedPrior`, one head (UVTomo-GAN)
known       a collection for each view           `Known` (MP-GAN)
single      one unlabelled collection            `Unassigned`, one head (PrGAN)
direct      the samples themselves               `Known`, the identity as projection (3D-GAN)
=========== ==================================== ================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Literal, get_args

import torch

from .._types import UserError
from ..assignment import (
    Estimator,
    JointlyPredicted,
    Known,
    LearnedPrior,
    MeanShapeInitialiser,
    Panel,
    Predicted,
    PredictorFit,
    Rounds,
    Unassigned,
    by_view,
    views_of,
)
from ..data import Collection
from ..networks import ViewPredictor
from ..projections.base import Identity
from ..projections.observation import Observation

Views = Literal["predicted", "learned", "known", "single", "direct"]

LEAST_STEPS = 10
"""Training steps between two rounds: in a short trial further rounds would take longer than training."""


def panel_of(
    views: Views,
    observations: Sequence[Observation],
    collection: Collection,
    predicted: Predicted | None = None,
    held_out: Collection | None = None,
) -> Panel:
    """Return the panel of these observations; for direct training `collection` holds the samples themselves.

    Args:
        predicted: the assignment of predicted views (default: `frequent_rounds(40, 0.8)`).
        held_out: images that discriminators never train on, as of `collection.split`. Known views of which there are
            no others have no head, so their images are left out.
    """
    if views == "direct":
        return Panel([Observation("itself", Identity())], collection, held_out=held_out)
    if views == "known":
        if held_out is not None:
            seen = views_of(collection, observations)
            rows = torch.isin(views_of(held_out, observations), seen).nonzero()[:, 0]
            held_out = held_out.subset(rows) if len(rows) else None
        return Panel(*by_view(collection, observations), Known(), held_out=held_out)
    if views not in get_args(Views):
        raise UserError(f"views={views!r}: choose from {', '.join(get_args(Views))}")
    unknown = {"learned": LearnedPrior(), "single": Unassigned()}
    assignment = unknown.get(views) or predicted or frequent_rounds(40, 0.8)
    return Panel(observations, collection, assignment, held_out=held_out)


MOST_ROUNDS = 10_000
"""More would come oftener than steps, and lie in memory."""


def frequent_rounds(rounds: int, balance: float, start: float = 0.05) -> Predicted:
    """Return many short rounds with views drawn from the responsibilities: stochastic EM.

    While the predictor is poor its draws are nearly random and training is PrGAN's; a few long rounds of most probable
    views would fix what the first, wrong shapes suggest.
    """
    if not 1 <= rounds <= MOST_ROUNDS or not 0 <= balance <= 1:
        raise UserError(f"rounds={rounds}, balance={balance}: give 1 to {MOST_ROUNDS} rounds and a balance of 0 to 1")
    starts = tuple(start + (0.98 - start) * k / rounds for k in range(rounds))
    return Predicted(
        Rounds(starts, LEAST_STEPS), PredictorFit(images=1024, steps=30), Estimator("posterior", balance=balance)
    )


def jointly_predicted(
    rounds: int,
    balance: float,
    information: float,
    mirrored: tuple[int, ...] | None = None,
    mean_shape: bool = False,
    anywhere: float = 0.0,
    window: int | None = None,
) -> JointlyPredicted:
    """Return many rounds with views drawn from the responsibilities of a predictor that is trained all along.

    The first are random, or those of one mean shape.
    """
    drawn = frequent_rounds(rounds, balance, start=0.01)
    initialiser = MeanShapeInitialiser(mirror=mirrored is not None, balance=balance) if mean_shape else None
    fit = replace(drawn.fit, mirrored=mirrored)
    estimator = replace(drawn.estimator, window=window, anywhere=anywhere or None)
    return JointlyPredicted(drawn.rounds, fit, estimator, initialiser, weight=information)


def five_rounds(steps: int, images: int, clusters: int | None = None, binarise: bool = False) -> Predicted:
    """Return the released schedule: five rounds of one length, a new view predictor in each, most probable views.

    Args:
        steps, images: of the predictor's fit in each round.
        clusters: discriminator heads by k-means of the responsibilities (default: one head a view).
        binarise: threshold images before the predictor sees them.
    """
    fit = PredictorFit(
        partial(ViewPredictor, channels=32), images, steps, batch=32, learning_rate=1e-3, binarise=binarise, fresh=True
    )
    return Predicted(Rounds((0.2, 0.4, 0.6, 0.8), restart=True), fit, Estimator(clusters=clusters))
