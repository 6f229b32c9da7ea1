"""Evaluation: the scores of samples, of their projections and of estimated views, each with its protocol."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from torch import Tensor

from .._random import derived_seed, generator_at, seeded
from .._types import UserError
from ..assignment import AssignmentState, Panel, PredictorFit
from ..assignment.views import views_if_known
from ..data import Collection
from ..data.measured_lines import standardised_lines
from ..domains import Domain
from ..metrics import Score, ViewAccuracy, view_accuracy, view_scores
from ..networks import Generator
from ..projections import Identity, LineIntegral
from .fitting import by_name, of_different_kinds

MIN_IMAGES = 6
"""Images that a panel's projections are compared with, at least."""


@torch.no_grad()
def sample_scores(
    generator: Generator,
    domain: Domain,
    assignments: Sequence[AssignmentState],
    references: Collection,
    n: int,
    seed: int = 0,
) -> dict[str, Score]:
    """Score n samples by themselves, and against references or their projections against projections.

    Lines whose `angle` is known are compared as from half a turn. Samples of a run on readings of another unit are in
    that unit (`data.measured_lines`), and so are references made then.

    Raises:
        UserError: if the references have the shape of neither, or of the pictures of several panels.
    """
    x = generator.sample(n, seed)
    reference = domain.comparable(references.floats(), x)
    if reference.shape[1:] == x.shape[1:]:
        _warn_if_pictures_too(assignments, x)
        times = _scale_of_samples(assignments)
        scores = domain.scores(x, reference * times, seed, turns_of(domain, assignments)) | domain.checks(x, seed)
        how = f"references times {times:.4g}, as the readings' unit makes them"
        return scores if times == 1 else {k: replace(s, protocol=f"{s.protocol}, {how}") for k, s in scores.items()}
    kinds, angle = of_different_kinds(assignments), (references.latents or {}).get("angle")
    fitting = [(state, given) for state in kinds if (given := _as_trained(state.panel, reference, angle)) is not None]
    if not fitting:
        shapes = ", ".join(str(tuple(shape)) for shape in (x.shape[1:], *(state.panel.shape for state in assignments)))
        raise UserError(
            f"the references are of shape {tuple(reference.shape[1:])}; give samples or projections, of shape {shapes}"
        )
    if len(fitting) > 1:
        names = ", ".join(state.panel.observations[0].name for state, _ in fitting)
        raise UserError(f"the references may be pictures of any of {names}; give samples")
    return _against(domain, *fitting[0], x, seed) | domain.checks(x, seed)


@torch.no_grad()
def observed_scores(
    generator: Generator,
    domain: Domain,
    assignments: Sequence[AssignmentState],
    references: Mapping[str, Tensor],
    n: int,
    seed: int = 0,
) -> dict[str, Score]:
    """Score n samples by themselves, and their projections against pictures of several observations: name → (N, ...).

    Raises:
        UserError: if there is no such observation, or its pictures are of another shape.
    """
    x = generator.sample(n, seed)
    of = by_name(assignments)
    scores = domain.checks(x, seed)
    for name, reference in references.items():
        if name not in of:
            raise UserError(f"the run has no observation {name!r}; give pictures of {', '.join(of)}")
        given = _as_trained(of[name].panel, reference)
        if given is None:
            shape, wanted = tuple(reference.shape[1:]), tuple(of[name].panel.shape)
            raise UserError(f"the references of {name} are of shape {shape}; give pictures of shape {wanted}")
        scores |= {f"{key}_{name}": score for key, score in _against(domain, of[name], given, x, seed).items()}
    return scores


def _warn_if_pictures_too(assignments: Sequence[AssignmentState], x: Tensor) -> None:
    """Warn if pictures of an operator have the shape of samples, and references may be either."""
    panels = [state.panel for state in assignments if not isinstance(state.panel.projection, Identity)]
    names = [panel.observations[0].name for panel in panels if panel.shape == x.shape[1:]]
    if names:
        warnings.warn(
            f"pictures of {names[0]} have the shape of samples: the references are compared with samples; if they are "
            f"pictures, name what of: --observation {names[0]}, or a mapping of that name in Python",
            stacklevel=4,
        )


def _scale_of_samples(assignments: Sequence[AssignmentState]) -> float:
    """Return how many times brighter samples are than images in the unit of readings: D / s of D detectors."""
    lines = [state.panel for state in assignments if isinstance(state.panel.projection, LineIntegral)]
    units = {panel.shape[-1] / panel.projection.unit for panel in lines if panel.projection.unit != 1}  # pyright: ignore
    return units.pop() if len(units) == 1 else 1.0


def _as_trained(panel: Panel, pictures: Tensor, angle: Tensor | None = None) -> Tensor | None:
    """Return pictures as they were measured, (N, ...), as a panel has them; None if they are of another shape."""
    if pictures.shape[1:-1] != panel.shape[:-1]:
        return None
    if isinstance(panel.projection, LineIntegral) and angle is not None:
        lines, read = Collection(pictures, latents={"angle": angle}), panel.projection
        given = standardised_lines(lines, len(panel.observations), read.unit, read.center).floats()
    else:
        given = panel.projection.from_measured(pictures)  # of lines the number of detectors may change
    return panel.projection.prepare(given) if given.shape[1:] == panel.shape else None


def _against(domain: Domain, state: AssignmentState, pictures: Tensor, x: Tensor, seed: int) -> dict[str, Score]:
    """Score projections of samples against pictures."""
    return domain.projection_scores(projected(state, x, seed), pictures, seed, state.panel.projection.silhouettes)


@torch.no_grad()
def self_checks(
    generator: Generator, domain: Domain, assignments: Sequence[AssignmentState], n: int, seed: int = 0
) -> dict[str, Score]:
    """Score what needs no reference: samples by themselves, their projections against the training data, the views.

    Of panels of the same kind, as of anchors beside lines of unknown direction, the first is scored.
    """
    x = generator.sample(n, seed)
    scores = domain.checks(x, seed)
    kinds = by_name(assignments)
    for name, state in kinds.items():
        found = {**picture_scores(domain, state, x, seed), **state.checks()}
        scores |= {f"{key}_{name}" if len(kinds) > 1 else key: score for key, score in found.items()}
    return scores


def picture_scores(domain: Domain, state: AssignmentState, x: Tensor, seed: int) -> dict[str, Score]:
    """Score projections of samples against as many training images of a panel."""
    count = min(len(x), len(state.panel))
    if count < MIN_IMAGES:
        return {}
    rows = torch.randperm(len(state.panel), generator=generator_at(seed, 0, "training images"))[:count]
    silhouettes = state.panel.projection.silhouettes
    found = domain.projection_scores(projected(state, x, seed), state.panel.batch(rows), seed, silhouettes)
    return {name: replace(score, protocol=_of_training(score.protocol)) for name, score in found.items()}


def _of_training(protocol: str) -> str:
    """Say of a protocol that the references are training images."""
    said = protocol.replace(" reference,", " training images,")
    return said if said != protocol else f"{protocol}, references are training images"


def estimated_view_scores(
    domain: Domain, assignments: Sequence[AssignmentState], seed: int = 0, ceiling: bool = False
) -> dict[str, Score]:
    """Score estimated views against known ones, of the first panel that has both; nothing if none has.

    Of an odd number of bins of a full turn there is no score, as reflections do not map them to one another, and of
    latents of your own that turn no sample (`Domain.turned_by`).

    Args:
        ceiling: also train a view predictor on the known views, which takes a minute or two.
    """
    for state in assignments:
        found = estimated_and_true(domain, state)
        if found is not None:
            rows, estimated, true = found
            best = supervised_ceiling(domain, state.panel, true, seed, rows=rows) if ceiling else None
            return view_scores(accuracy_of(domain, state.panel, estimated[rows], true[rows], seed), best, seed)
    return {}


def estimated_and_true(domain: Domain, state: AssignmentState) -> tuple[Tensor, Tensor, Tensor] | None:
    """Return rows whose views were estimated, and estimated and known views of all (N,); None where these lack."""
    observations = state.panel.observations
    if not domain.turns_by(observations):
        return None
    estimated = state.estimates()
    true = None if estimated is None else true_views(state.panel)
    if estimated is None or true is None:
        return None
    if domain.bins(observations) % 2 and not domain.half_turn(observations):
        return None  # a reflection maps these bins to no bins
    return (estimated >= 0).nonzero()[:, 0], estimated, true  # of a large collection some are estimated


def turns_of(domain: Domain, assignments: Sequence[AssignmentState]) -> int | None:
    """Return how many turns of a sample explain the data; None if some panel fixes the pose or none has views."""
    if any(state.fixes_gauge for state in assignments) or not assignments:
        return None
    turns = [domain.turns(state.panel.observations, state.fixes_gauge) for state in assignments]
    return None if None in turns else turns[0]


def true_views(panel: Panel) -> Tensor | None:
    """Return (N,) the observation that made each image of a panel's only collection; None if that is not known."""
    return views_if_known(panel.collections[0], panel.observations) if len(panel.collections) == 1 else None


def supervised_ceiling(
    domain: Domain, panel: Panel, true: Tensor, seed: int, steps: int = 600, *, rows: Tensor | None = None
) -> ViewAccuracy:
    """Return what the same predictor reaches when trained on true labels: two-fold, by halves of the collection.

    Each half of the images is predicted by a predictor that saw only the other half. Images of one shape lie
    together, so hardly any shape is in both halves.

    Args:
        rows: the images that it is measured on, in order (default: all).

    Raises:
        UserError: for a single image.
    """
    fit = replace(getattr(panel.assignment, "fit", PredictorFit()), steps=steps)
    rows = torch.arange(len(true)) if rows is None else rows
    if len(rows) < 2:
        raise UserError("the ceiling needs two pictures at least, one to learn from and one to predict")
    folds = (rows[: len(rows) // 2], rows[len(rows) // 2 :])
    predicted = torch.empty_like(true)
    for fold, (test, train) in enumerate(zip(folds, folds[::-1], strict=True)):
        with seeded(seed, f"ceiling/{fold}"):
            predictor = fit.network(panel.shape, len(panel.observations))
        fit.fitted(predictor, panel.batch(train), true[train], derived_seed(seed, fold, "ceiling"))
        predicted[test] = fit.probabilities(predictor, (panel.batch(some) for some in test.split(512))).argmax(1)
    return accuracy_of(domain, panel, predicted[rows], true[rows], seed)


def accuracy_of(domain: Domain, panel: Panel, predicted: Tensor, true: Tensor, seed: int = 0) -> ViewAccuracy:
    """Return the accuracy up to gauge, by the first latent alone: azimuth, whatever the elevation, or angle."""
    bins = domain.bins(panel.observations)
    each = len(panel.observations) // bins
    half, mirrored = domain.half_turn(panel.observations), domain.open_reflection
    return view_accuracy(predicted // each, true // each, bins, half=half, mirrored=mirrored, seed=seed)


def projected(state: AssignmentState, x: Tensor, seed: int) -> Tensor:
    """Project samples in views as frequent as those of the panel's data."""
    rng = generator_at(seed, 0, "evaluation views")
    return state.observe(x, state.draw_views(len(x), rng), rng)
