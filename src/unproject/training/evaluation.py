"""Evaluation: the scores of a run, each with its protocol."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from .._random import derived_seed, generator_at, seeded
from .._types import UserError
from ..adversarial.assignment import Predicted, predict, train_predictor
from ..data import Collection
from ..metrics import Score, ViewAccuracy, shape_scores, silhouette_scores, view_accuracy, view_scores
from ..networks import ViewPredictor
from . import checkpoint
from .panel import Panel, build_panels
from .recipe import Recipe
from .run_directory import Run


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
        reference: held-out volumes or silhouettes; None: only scores that need none.
        n: how many things to generate.
        ceiling: also train a view predictor on the true labels, which takes a minute or two.

    Raises:
        UserError: if there is nothing to score against.
    """
    panel = assigned_panel(run, recipe)
    generated = run.generator.sample(n, seed)
    scores: dict[str, Score] = {}
    if reference is not None and reference.items.dim() == 4 and reference.items.shape[1:] == generated.shape[1:]:
        bins = _gauge_bins(recipe, panel)
        scores |= shape_scores(generated, reference.items, selection=None, bins=bins, seed=seed)
    elif reference is not None:
        scores |= silhouette_scores(_seen(panel, generated, seed), reference.items, seed=seed)
    true = true_views(recipe, panel)
    if isinstance(recipe.assignment, Predicted) and true is not None:
        bins = azimuth_count(panel)
        per_bin = len(panel.observations) // bins
        found = view_accuracy(panel.ways // per_bin, true // per_bin, bins)
        best = supervised_ceiling(panel, true, recipe.seed) if ceiling else None
        scores |= view_scores(found, best, seed)
    if not scores:
        raise UserError(f"{run.path}: nothing to score against; give --reference, held-out shapes or silhouettes")
    return scores


def assigned_panel(run: Run, recipe: Recipe) -> Panel:
    """The first panel of a run with the ways of looking that its newest checkpoint assigned."""
    panel = build_panels(recipe)[0]
    stored = checkpoint.load(checkpoint.newest(Path(run.path) / "checkpoints"), "panels/0/")
    panel.ways, panel.heads = stored["panels/0/ways"], stored["panels/0/heads"]
    return panel


def true_views(recipe: Recipe, panel: Panel) -> Tensor | None:
    """The observation whose prior contains the known latents of each image; None if they are not known."""
    latents = recipe.looks[0][1].latents
    if latents is None or panel.items.dim() != 4 or "azimuth" not in latents:
        return None
    known = {"elevation": torch.zeros(len(panel.items)), **latents}
    inside = torch.stack([observation.prior.contains(known) for observation in panel.observations], 1)
    return inside.long().argmax(1) if bool(inside.any(1).all()) else None


def supervised_ceiling(panel: Panel, true: Tensor, seed: int, steps: int = 600) -> ViewAccuracy:
    """What the same predictor reaches when it is trained on true labels: two-fold, by halves of the collection.

    Each half of the images is predicted by a predictor that saw only the other half. Images of one shape lie
    together, so hardly any shape is in both halves.
    """
    settings = Predicted(ViewPredictor, steps=steps)
    ways, bins = len(panel.observations), azimuth_count(panel)
    half = len(true) // 2
    folds = (torch.arange(half), torch.arange(half, len(true)))
    predicted = torch.empty_like(true)
    for fold, (test, train) in enumerate(zip(folds, folds[::-1], strict=True)):
        with seeded(seed, f"ceiling/{fold}"):
            predictor = settings.predictor(panel.shape, ways)
        train_predictor(predictor, panel.items[train], true[train], settings, derived_seed(seed, fold, "ceiling"))
        predicted[test] = predict(predictor, panel.items[test]).argmax(1)
    per_bin = ways // bins
    return view_accuracy(predicted // per_bin, true // per_bin, bins)


def azimuth_count(panel: Panel) -> int:
    """How many azimuth bins the observations have; bands of elevation share them."""
    azimuths = {getattr(o.prior, "factors", (o.prior,))[0] for o in panel.observations}
    return len(azimuths)


def _gauge_bins(recipe: Recipe, panel: Panel) -> int | None:
    """Turns are free unless the views are known; one look from all around leaves every turn free."""
    if isinstance(recipe.assignment, Predicted):
        return azimuth_count(panel)
    return 16 if panel.items.dim() == 4 and len(panel.observations) == 1 and panel.items.shape[1] == 1 else None


def _seen(panel: Panel, generated: Tensor, seed: int) -> Tensor:
    """Generated things seen in the ways the collection was."""
    rng = generator_at(seed, 0, "evaluation views")
    way = panel.ways[torch.randint(len(panel.ways), (len(generated),), generator=rng)]
    return panel.look(generated, way, rng)
