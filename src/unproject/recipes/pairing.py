"""Which collection goes with which way of looking: the one thing that differs between the arms of a comparison.

=========== ============================================== ==========================================
views       looks                                          assignment
=========== ============================================== ==========================================
predicted   every way, one unlabelled collection           `Predicted` (VP-MP-GAN)
learned     every way, one unlabelled collection           `LearnedPrior`, one head (UVTomo-GAN)
known       every way, each with its own images            `Known` (MP-GAN)
single      one look in any of the ways                    `Known`, one head (PrGAN)
direct      the identity on the things themselves          `Known`, one head (3D-GAN)
=========== ============================================== ==========================================
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Literal

import torch

from .._types import UserError
from ..adversarial.assignment import Known, Predicted
from ..adversarial.learned_prior import LearnedPrior
from ..data import Collection
from ..networks import ViewPredictor
from ..projections.base import Identity
from ..projections.observation import Observation
from ..projections.priors import Mixture, Product
from ..training.recipe import Looks

Views = Literal["predicted", "learned", "known", "single", "direct"]


def pair(views: Views, ways: Sequence[Observation], collection: Collection) -> Looks:
    """Pair ways of looking with what they saw; `collection` holds the things themselves for direct training."""
    if views == "direct":
        return [(Observation("itself", Identity(), Product()), collection)]
    if views == "single":
        return [(Observation("anywhere", ways[0].projection, Mixture([way.prior for way in ways])), collection)]
    if views in ("predicted", "learned"):
        return [(way, collection) for way in ways]
    return by_known_view(collection, ways)


def by_known_view(collection: Collection, ways: Sequence[Observation]) -> Looks:
    """Give each observation the images whose known view its prior contains."""
    names = ways[0].prior.names
    first = names[0]
    if collection.latents is None or first not in collection.latents:
        raise UserError(
            f"{collection.source}: known views are asked for but none are there; add a views.csv (file,{first} in "
            f"degrees) to a folder or an array `{first}` (radians) to an .npz, or use --views predicted"
        )
    latents = {name: torch.zeros(len(collection)) for name in names} | collection.latents
    inside = torch.stack([observation.prior.contains(latents) for observation in ways]).any(0)
    if not bool(inside.all()):
        more = ", or give --bands enough bands of elevation" if "elevation" in names else ""
        raise UserError(
            f"{collection.source}: the known view of {int((~inside).sum())} of {len(inside)} images lies outside every "
            f"bin; leave them out{more}"
        )
    looks = []
    for observation in ways:
        rows = observation.prior.contains(latents).nonzero()[:, 0]
        if len(rows):
            looks.append((observation, collection.subset(rows)))
    return looks


def modern_assignment(views: Views, predicted: Predicted) -> Known | Predicted | LearnedPrior:
    """What goes with `views`: `predicted`, such as `little_and_often`; a learned prior; or nothing."""
    if views == "learned":
        return LearnedPrior()
    return predicted if views == "predicted" else Known()


def paper_assignment(
    views: Views, steps: int, clusters: int | None, binarise: bool = False, images: int = 65536
) -> Known | Predicted | LearnedPrior:
    """What goes with `views`: five rounds of the most probable view; a learned prior; or nothing."""
    if views == "learned":
        return LearnedPrior()
    return five_rounds(steps, clusters, binarise, images) if views == "predicted" else Known()


def little_and_often(rounds: int, balance: float, start: float = 0.05) -> Predicted:
    """Many short rounds, each image's way drawn from what the predictor thinks of it: stochastic EM.

    While the predictor knows little its draws are nearly random and training is PrGAN's; a few long rounds of
    most probable ways instead lock in whatever the first, wrong shapes suggest.
    """
    if rounds < 1 or not 0 <= balance <= 1:
        raise UserError(f"rounds={rounds}, balance={balance}: give at least 1 round and a balance of 0 to 1")
    starts = tuple(start + (0.98 - start) * k / rounds for k in range(rounds))
    return Predicted(ViewPredictor, starts, images=1024, steps=30, draw="posterior", balance=balance)


def five_rounds(steps: int, clusters: int | None, binarise: bool = False, images: int = 65536) -> Predicted:
    """The released schedule: five rounds of one length, a fresh view predictor in each, most probable views."""
    predictor = partial(ViewPredictor, channels=32)
    starts = (0.2, 0.4, 0.6, 0.8)
    return Predicted(
        predictor,
        starts,
        images=images,
        steps=steps,
        batch=32,
        learning_rate=1e-3,
        clusters=clusters,
        restart=True,
        binarise=binarise,
        fresh=True,
    )
