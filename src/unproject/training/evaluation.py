"""Evaluation: the scores of a run, each with its protocol."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

from .._random import derived_seed, generator_at, seeded
from .._types import UserError
from ..adversarial.assignment import Known, Predicted, predict, train_predictor
from ..data import Collection
from ..metrics import (
    Score,
    ViewAccuracy,
    image_scores,
    line_scores,
    material_scores,
    shape_scores,
    silhouette_scores,
    view_accuracy,
    view_scores,
)
from ..networks import ViewPredictor
from ..ops.maps import kind_of
from ..projections.observation import Observation
from ..projections.priors import Prior
from . import checkpoint
from .panel import Panel, build_panels
from .pictures import LIGHTS, relit
from .recipe import Recipe
from .run_directory import Run

ANYWHERE = 16  # turns tried where nothing says how many there are


def evaluate(
    run: Run,
    recipe: Recipe,
    reference: Collection | None,
    n: int = 256,
    seed: int = 0,
    ceiling: bool = False,
) -> dict[str, Score]:
    """Score a run on everything it allows.

    Args:
        reference: held-out things, or held-out silhouettes or line integrals; None: only scores that need none.
        n: how many things to generate.
        ceiling: also train a view predictor on the true labels, which takes a minute or two.

    Raises:
        UserError: if there is nothing to score against.
    """
    panel = assigned_panel(run, recipe)
    generated = run.generator.sample(n, seed)
    scores: dict[str, Score] = {}
    if reference is not None:
        scores |= _scores(recipe, panel, generated, reference.floats(), seed)
    true = true_views(recipe, panel)
    if isinstance(recipe.assignment, Predicted) and true is not None:
        best = supervised_ceiling(panel, true, recipe.seed) if ceiling else None
        scores |= view_scores(assigned_accuracy(panel, panel.ways, true), best, seed)
    if not scores:
        raise UserError(f"{run.path}: nothing to score against; give --reference, held-out things of the same kind")
    return scores


def score_things(things: Tensor, reference: Tensor, seed: int = 0, turns: int | None = None) -> dict[str, Score]:
    """Score things against true ones of the same kind, shape (N, ...): maps, images or volumes.

    Args:
        turns: of how many turns of the things the best is taken; None: they stand as they should. Maps never turn.
    """
    if kind_of(things) == "maps":
        return material_scores(things, reference, seed, rendered_alike(things, reference))
    score = image_scores if kind_of(things) == "image" else shape_scores
    return score(things, reference, selection=None, bins=turns, seed=seed)


def _scores(recipe: Recipe, panel: Panel, generated: Tensor, reference: Tensor, seed: int) -> dict[str, Score]:
    """The scores that fit what the references are: the things themselves, or what was seen of such things."""
    if reference.shape[1:] == generated.shape[1:]:
        turns = None if kind_of(generated) == "maps" else free_turns(recipe, panel)
        return score_things(generated, reference, seed, turns)
    seen = _seen(panel, generated, seed)
    if reference.shape[1:] != seen.shape[1:]:
        raise UserError(
            f"references are of shape {tuple(reference.shape[1:])}, which is neither that of what is generated, "
            f"{tuple(generated.shape[1:])}, nor that of what is seen of it, {tuple(seen.shape[1:])}"
        )
    score = line_scores if reference.dim() == 3 else silhouette_scores
    return score(seen, reference, seed=seed)


def rendered_alike(generated: Tensor, reference: Tensor) -> dict[str, tuple[Tensor, Tensor]]:
    """Both sets of maps under the same lights, those of `relit`."""
    pairs = zip(relit(generated), relit(reference), strict=True)
    return dict(zip(("lamp", *(name for name, _ in LIGHTS)), pairs, strict=True))


def assigned_panel(run: Run, recipe: Recipe) -> Panel:
    """The first panel of a run with the ways of looking that its newest checkpoint assigned.

    With a learned prior no image has one: there they are draws from it, right as a whole.
    """
    panel = build_panels(recipe)[0]
    newest = checkpoint.newest(Path(run.path) / "checkpoints")
    stored = checkpoint.load(newest, "panels/0/")
    panel.ways, panel.heads = stored["panels/0/ways"], stored["panels/0/heads"]
    if panel.distribution is not None:
        panel.distribution.load_state_dict({"logits": checkpoint.load(newest, "way_distribution/logits").popitem()[1]})
        shares, rng = panel.distribution.shares.detach(), generator_at(recipe.seed, 0, "drawn ways")
        panel.ways = torch.multinomial(shares, len(panel.ways), replacement=True, generator=rng)
    return panel


def true_views(recipe: Recipe, panel: Panel) -> Tensor | None:
    """The observation whose prior contains the known latents of each image; None if they are not known."""
    latents, names = recipe.looks[0][1].latents, panel.observations[0].prior.names
    if latents is None or not names or names[0] not in latents:
        return None
    known = {name: torch.zeros(len(panel.items)) for name in names} | latents
    inside = torch.stack([observation.prior.contains(known) for observation in panel.observations], 1)
    return inside.long().argmax(1) if bool(inside.any(1).all()) else None


def supervised_ceiling(panel: Panel, true: Tensor, seed: int, steps: int = 600) -> ViewAccuracy:
    """What the same predictor reaches when it is trained on true labels: two-fold, by halves of the collection.

    Each half of the images is predicted by a predictor that saw only the other half. Images of one shape lie
    together, so hardly any shape is in both halves.
    """
    settings = Predicted(ViewPredictor, steps=steps)
    ways = len(panel.observations)
    half = len(true) // 2
    folds = (torch.arange(half), torch.arange(half, len(true)))
    predicted = torch.empty_like(true)
    for fold, (test, train) in enumerate(zip(folds, folds[::-1], strict=True)):
        with seeded(seed, f"ceiling/{fold}"):
            predictor = settings.predictor(panel.shape, ways)
        train_predictor(predictor, panel.items[train], true[train], settings, derived_seed(seed, fold, "ceiling"))
        predicted[test] = predict(predictor, panel.items[test]).argmax(1)
    return assigned_accuracy(panel, predicted, true)


def assigned_accuracy(panel: Panel, predicted: Tensor, true: Tensor) -> ViewAccuracy:
    """Up to gauge, by the first latent alone: azimuth, whatever the elevation, or angle."""
    bins = bin_count(panel)
    each = len(panel.observations) // bins
    return view_accuracy(predicted // each, true // each, bins, half=cover_half_a_turn(panel.observations))


def bin_count(panel: Panel) -> int:
    """How many bins of the first latent the observations have; bands of elevation share them."""
    return len(_firsts([observation.prior for observation in panel.observations]))


def _firsts(priors: Sequence[Prior]) -> set[Prior]:
    """The different priors of the first latent."""
    return {getattr(prior, "factors", (prior,))[0] for prior in priors}


def free_turns(recipe: Recipe, panel: Panel) -> int | None:
    """Of how many turns the best is to be taken when things are scored; None if they stand as they should.

    Where nobody knows the views, any turn by a bin explains the same pictures, and where there is one look from
    everywhere any turn at all does. Directions of line integrals cover half a turn, so twice as many make a whole one.
    """
    names, prior = panel.observations[0].prior.names, panel.observations[0].prior
    if not names or (isinstance(recipe.assignment, Known) and len(panel.observations) > 1):
        return None
    several = len(panel.observations) > 1
    bins = bin_count(panel) if several else len(_firsts(getattr(prior, "parts", ()))) or ANYWHERE
    return 2 * bins if cover_half_a_turn(panel.observations) else bins


def cover_half_a_turn(observations: Sequence[Observation]) -> bool:
    """Whether these are directions of line integrals, none opposite to another."""
    if observations[0].prior.names[0] != "angle":
        return False
    draws = [o.prior.sample(64, generator_at(0, i, "angles"))["angle"] for i, o in enumerate(observations)]
    middles = F.normalize(torch.stack([torch.stack([draw.cos(), draw.sin()]).mean(1) for draw in draws]), dim=1)
    return not bool((middles @ middles.T < -0.95).any())


def _seen(panel: Panel, generated: Tensor, seed: int) -> Tensor:
    """Generated things seen in the ways the collection was."""
    rng = generator_at(seed, 0, "evaluation views")
    way = panel.ways[torch.randint(len(panel.ways), (len(generated),), generator=rng)]
    return panel.look(generated, way, rng)
