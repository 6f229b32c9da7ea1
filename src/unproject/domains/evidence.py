"""Evidence: the pictures that a run is judged by, and what their distances say of any domain.

With g generated pictures, r real held-out ones and t training pictures of other objects, as many as there are g,

    match = mean_r min_g D(r, g) / mean_r min_t D(r, t)        1 if generated pictures are as near as other real ones
    variety = mean D(g, g') / mean D(r, r')                    well below 1 if samples are alike
    labels = mean_r min_{g in r's view} D / mean_r min_{g in another's view} D        1 if known views tell nothing
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from torch import Tensor

from ..metrics import Finding, Score

MIN_PICTURES = 8
"""Pictures a set, at least."""
MATCH, VARIETY, ALIKE, LABELS = (1.4, 1.6), (0.75, 0.5), (0.45, 0.55), (0.92, math.inf)
"""Levels (doubtful, failed), chosen on benchmarks/verdicts.py and on chairs, beds and tables of ModelNet."""


@dataclass(frozen=True)
class Evidence:
    """Pictures of a panel.

    Attributes:
        generated: (N, ...), projections of samples in views as frequent as those of the data.
        views: (N,) their observations.
        real: (M, ...), held out or drawn from the training pictures.
        real_views: (M,) their observations if those are known.
        others: (T, ...), training pictures.
        apart: (M, T), whether a training picture surely shows another object than the real one.
        silhouettes: whether they are silhouettes.
    """

    generated: Tensor
    views: Tensor
    real: Tensor
    real_views: Tensor | None
    others: Tensor
    apart: Tensor
    silhouettes: bool

    @property
    def is_enough(self) -> bool:
        return self.compared >= MIN_PICTURES and bool((self.apart.sum(1) > 0).all())

    @property
    def compared(self) -> int:
        """Pictures that can be compared with one of another object."""
        return min(len(self.generated), len(self.real), int((self.apart.sum(1) > 0).sum()))


def nearest(distance: Tensor, among: Tensor) -> float:
    """Return the mean over rows of the least distance to the columns that `among` (R, C) leaves."""
    return distance.masked_fill(~among, float("inf")).amin(1).mean().item()


def few_finding(seen: Evidence, seed: int) -> Finding:
    """Say that there are too few pictures to judge by."""
    count = seen.compared
    score = Score(count, "real pictures that can be compared with one of another object", count, seed)
    says = f"{count} pictures can be compared with others, which is too few to judge by"
    return Finding("few", score, max(count, MIN_PICTURES), -math.inf, says, "give more pictures, at least a hundred")


MANY = 100


def match_finding(ratio: float, protocol: str, n: int, levels: tuple[float, float], seed: int) -> Finding:
    """Judge how far generated pictures are from real ones, relative to other real ones."""
    times = f"{ratio:.2f}" if ratio < MANY else f"over {MANY}"  # pictures that are all alike are no distance apart
    far = f"held-out pictures are {times} times as far from generated ones as from other training pictures"
    says = f"generated pictures match ({ratio:.2f} times the distance of real ones)" if ratio < levels[0] else far
    advice = "train longer (unproject resume --minutes); if it stays, look at the pictures (unproject data inspect)"
    return Finding("match", Score(ratio, protocol, n, seed), *levels, says, advice)


def variety_finding(ratio: float, protocol: str, n: int, seed: int) -> Finding:
    """Judge how different generated pictures are from one another."""
    says = f"generated pictures vary {ratio:.2f} times as much as real ones"
    return Finding(
        "variety", Score(ratio, protocol, n, seed), *VARIETY, says, "samples are alike: try a lower --rate or more data"
    )


def likeness_finding(distance: float, n: int, seed: int) -> Finding:
    """Judge whether silhouettes have anything in common with one another."""
    how = "mean 1-iou of a held-out silhouette to the nearest training silhouette of another object"
    says = f"pictures differ by {distance:.0%} from the most similar other picture"
    advice = "look for noise, wrong thresholds and mixed objects: unproject data inspect"
    return Finding("likeness", Score(distance, how, n, seed), *ALIKE, says, advice)


def label_finding(distance: Tensor, seen: Evidence, seed: int) -> list[Finding]:
    """Judge whether known views tell of pictures: distances (M, N) to generated ones in the same and in other views."""
    if seen.real_views is None:
        return []
    own = seen.views[None] == seen.real_views[:, None]
    others = seen.real_views.roll(len(seen.real_views) // 2)
    other = seen.views[None] == others[:, None]
    rows = own.any(1) & other.any(1) & (others != seen.real_views)
    if int(rows.sum()) < MIN_PICTURES:
        return []
    ratio = nearest(distance[rows], own[rows]) / max(nearest(distance[rows], other[rows]), 1e-6)
    how = "mean distance of held-out pictures to the nearest generated one in their view, over that in another's view"
    fit = ratio < LABELS[0]
    says = "known views fit the pictures" if fit else f"known views tell little of the pictures (ratio {ratio:.2f})"
    advice = "check the angles of views.csv; objects that look alike from all sides are fine"
    return [Finding("labels", Score(ratio, how, int(rows.sum()), seed), *LABELS, says, advice)]


def pairs(distance: Tensor) -> float:
    """Return the mean distance (N, N) of two different members."""
    n = len(distance)
    return (distance.sum() / max(n * (n - 1), 1)).item()
