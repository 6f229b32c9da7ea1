"""Accuracy of predicted views up to the gauge, which silhouettes leave undetermined.

With predicted bins p and true bins t of K, and the 2K relabellings q(p) = ±p + c (mod K) of `gauge`,

    exact = max over q of  mean [q(p) = t]          within one = mean [|q(p) - t| ≤ 1 around the circle], same q

The directions of line integrals cover half a turn: there K is twice their number, and q is taken modulo K / 2.

Line integrals leave a reflection M open for each image by itself (`open_turns`): the line of x in direction t of n is
that of M x in direction n - 1 - t. So for them both count as right too:

    exact mirrored = max over q of  mean [q(p) = t or q(p) = n - 1 - t]

Random labels score above 1/K, because the best of 2K relabellings is taken. The chance level is the mean of that
maximum over shuffles of the predicted labels.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError
from .gauge import Gauge, dihedral
from .score import Score

TRIALS = 200


@dataclass(frozen=True, eq=False)
class ViewAccuracy:
    """The result of `view_accuracy`.

    Attributes:
        exact: share of views in the right bin, in the best gauge.
        within_one: share in the right bin or one next to it, in that same gauge.
        gauge: the map from the shapes whose views were predicted to the frame of the true views, equal to
            `best_gauge(generated, reference)` for a perfect generator. true = gauge.inverse.view(p).
        confusion: (K, K) counts, rows the true bin, columns the predicted bin after relabelling.
        chance_exact, chance_within_one: mean scores of shuffled labels.
        exact_mirrored, chance_exact_mirrored: of line integrals, up to the reflection of each image too; else None.
    """

    exact: float
    within_one: float
    gauge: Gauge
    confusion: Tensor
    chance_exact: float
    chance_within_one: float
    exact_mirrored: float | None = None
    chance_exact_mirrored: float | None = None

    @property
    def n(self) -> int:
        """Number of views."""
        return int(self.confusion.sum())


def view_accuracy(
    predicted: Tensor,
    true: Tensor,
    bins: int = 16,
    *,
    half: bool = False,
    mirrored: bool = False,
    seed: int = 0,
    trials: int = TRIALS,
) -> ViewAccuracy:
    """Compute the accuracy of predicted view bins, maximised over the 2 · bins dihedral relabellings.

    Of relabellings with equal `exact` the one with the larger `within_one` is taken, then the first.

    Args:
        predicted: (N,) integers in [0, bins).
        true: (N,) integers in [0, bins).
        bins: azimuth bins of a full turn, an even number; or directions of half a turn, any number.
        half: the bins cover half a turn, as directions of line integrals do.
        mirrored: of line integrals: also score up to the reflection of each image. Without `half` the directions over
            half a turn are the first half of the bins.
        seed, trials: of the Monte Carlo chance level.

    Raises:
        UserError: if there are no labels, their numbers differ, or one lies outside [0, bins).

    Examples:
        >>> import torch, unproject as up
        >>> true = torch.arange(16)
        >>> found = up.metrics.view_accuracy((true + 3) % 16, true, bins=16, trials=10)
        >>> found.exact, found.gauge.turn
        (1.0, 3)
    """
    _check_labels(predicted, true, bins)
    table = _relabellings(bins, half)
    found = _confusions(predicted[None].long(), true.long(), bins)
    exact, within = (score[0] for score in _scores(found, table))
    best = max(range(len(table)), key=lambda q: (exact[q].item(), within[q].item()))
    counts = [torch.bincount(labels.long(), minlength=bins) for labels in (predicted, true)]
    shuffles = _shuffles(counts[0], counts[1], seed, trials)
    chance = _mean_of_best(shuffles, table, len(true))
    confusion = found[0][:, table[best].argsort()].long()
    result = ViewAccuracy(exact[best].item(), within[best].item(), _gauges(bins, half)[best], confusion, *chance)
    if not mirrored:
        return result
    directions = bins if half else bins // 2
    level, chance = (_exact_mirrored(some, table, directions).mean().item() for some in (found, shuffles))
    return replace(result, exact_mirrored=level, chance_exact_mirrored=chance)


def chance_level(
    predicted_counts: Tensor, true_counts: Tensor, *, half: bool = False, seed: int = 0, trials: int = TRIALS
) -> tuple[float, float]:
    """Return the mean (exact, within one) of `view_accuracy` for labels independent of the truth.

    Monte Carlo over shuffles of the predicted labels, which keep both histograms: a predictor that always predicts the
    same bin is compared with one that does so too. For n uniform views of K give `torch.full((K,), n // K)` twice.

    Args:
        predicted_counts: (K,) number of predictions of each bin.
        true_counts: (K,) number of views of each bin; the same total.
        half: see `view_accuracy`.
        seed: of the shuffles.
        trials: shuffles; the standard error is that of one score over √trials.
    """
    shuffles = _shuffles(predicted_counts, true_counts, seed, trials)
    return _mean_of_best(shuffles, _relabellings(len(true_counts), half), int(true_counts.sum()))


def _shuffles(predicted_counts: Tensor, true_counts: Tensor, seed: int, trials: int) -> Tensor:
    """Return the confusions (trials, K, K) of labels with these histograms that are independent of one another."""
    bins = len(true_counts)
    predicted, true = (torch.arange(bins).repeat_interleave(c.long()) for c in (predicted_counts, true_counts))
    _check_labels(predicted, true, bins)
    rng = generator_at(seed, 0, "chance")
    shuffled = torch.stack([predicted[torch.randperm(len(predicted), generator=rng)] for _ in range(trials)])
    return _confusions(shuffled, true, bins)


def _mean_of_best(confusions: Tensor, table: Tensor, n: int) -> tuple[float, float]:
    """Return the mean (exact, within one) over confusions of n labels, each in its best gauge."""
    exact, within = _scores(confusions, table)
    # Of gauges that are equally exact, the one with more within one. Shares are multiples of 1 / n.
    best = (exact + within / (2 * n)).argmax(1, keepdim=True)
    return exact.amax(1).mean().item(), within.gather(1, best).mean().item()


def of_ceiling(accuracy: ViewAccuracy, ceiling: ViewAccuracy) -> float:
    """Return the accuracy as a share of that of a predictor trained on the true labels."""
    if ceiling.exact <= 0:
        raise UserError("of_ceiling: the ceiling has accuracy 0; train the supervised predictor first")
    return accuracy.exact / ceiling.exact


def view_scores(accuracy: ViewAccuracy, ceiling: ViewAccuracy | None = None, seed: int = 0) -> dict[str, Score]:
    """Return `view_exact`, `view_within_one`, chance levels and, with a ceiling, the ceiling and the share of it."""
    bins, n = len(accuracy.confusion), accuracy.n
    what = "azimuth bins" if bins == accuracy.gauge.bins else "directions of half a turn"
    setting = f"{bins} {what}, best of {2 * bins} dihedral relabellings by exact accuracy, {n} views"
    values = {
        "view_exact": (accuracy.exact, "exact accuracy of the most probable view"),
        "view_within_one": (accuracy.within_one, "accuracy within one bin"),
        "view_chance_exact": (accuracy.chance_exact, "mean exact accuracy of shuffled labels"),
        "view_chance_within_one": (accuracy.chance_within_one, "mean accuracy within one bin of shuffled labels"),
    }
    if ceiling is not None:
        values["view_ceiling_exact"] = (ceiling.exact, "exact accuracy of a predictor trained on true labels")
        values["view_of_ceiling"] = (of_ceiling(accuracy, ceiling), "exact accuracy over that of the ceiling")
    if accuracy.exact_mirrored is not None:
        values |= _mirrored_values(accuracy, ceiling)
    return {name: Score(value, f"{what}, {setting}", n, seed) for name, (value, what) in values.items()}


def _mirrored_values(accuracy: ViewAccuracy, ceiling: ViewAccuracy | None) -> dict[str, tuple[float, str]]:
    """Return what `view_scores` says of accuracies up to the reflection of each image."""
    of = "exact accuracy up to the reflection of each image"
    values = {
        "view_exact_mirrored": (accuracy.exact_mirrored or 0.0, of),
        "view_chance_exact_mirrored": (accuracy.chance_exact_mirrored or 0.0, f"mean {of} of shuffled labels"),
    }
    if ceiling is not None and ceiling.exact_mirrored:
        share = (accuracy.exact_mirrored or 0.0) / ceiling.exact_mirrored
        values["view_of_ceiling_mirrored"] = (share, f"{of} over that of a predictor trained on true labels")
    return values


def _gauges(bins: int, half: bool) -> tuple[Gauge, ...]:
    """Return all gauges; for half a turn only one of each two that differ by half a turn, which are equivalent."""
    return tuple(g for g in dihedral(2 * bins) if g.turn < bins) if half else dihedral(bins)


def _relabellings(bins: int, half: bool) -> Tensor:
    """Return Q[g, p], the true bin of prediction p if gauge g maps the learned frame to the true one."""
    return torch.stack([gauge.inverse.view(torch.arange(bins)) % bins for gauge in _gauges(bins, half)])


def _confusions(predicted: Tensor, true: Tensor, bins: int) -> Tensor:
    """Return C[i, t, p], the number of views of bin t predicted as p in row i of `predicted` (I, N)."""
    cell = (torch.arange(len(predicted))[:, None] * bins + true) * bins + predicted
    return torch.bincount(cell.flatten(), minlength=len(predicted) * bins**2).view(-1, bins, bins).double()


def _scores(confusions: Tensor, table: Tensor) -> tuple[Tensor, Tensor]:
    """Return (exact, within one) of every confusion under every relabelling, (I, 2K) each."""
    bins = confusions.shape[-1]
    off = (table[:, None, :] - torch.arange(bins)[None, :, None]).remainder(bins)
    hit, near = (off == 0).double(), ((off <= 1) | (off == bins - 1)).double()
    total = confusions.sum((1, 2))[:, None]
    exact, within = (torch.einsum("itp,gtp->ig", confusions, mask) / total for mask in (hit, near))
    return exact, within


def _exact_mirrored(confusions: Tensor, table: Tensor, directions: int) -> Tensor:
    """Return the accuracy (I,) up to the reflection of each image, each in its best gauge."""
    bins = confusions.shape[-1]
    true = torch.arange(bins)[None, :, None]
    called = table[:, None, :]
    hit = (called == true) | (called == (directions - 1 - true).remainder(bins))
    exact = torch.einsum("itp,gtp->ig", confusions, hit.double()) / confusions.sum((1, 2))[:, None]
    return exact.amax(1)


def _check_labels(predicted: Tensor, true: Tensor, bins: int) -> None:
    if predicted.ndim != 1 or predicted.shape != true.shape or len(true) == 0:
        raise UserError(
            f"views: give one predicted and one true bin a picture, at least one, not {tuple(predicted.shape)} "
            f"and {tuple(true.shape)}"
        )
    both = torch.stack([predicted.long(), true.long()])
    if both.min() < 0 or both.max() >= bins:
        raise UserError(f"views: bins run from 0 to {bins - 1}, but {int(both.min())}...{int(both.max())} were given")
