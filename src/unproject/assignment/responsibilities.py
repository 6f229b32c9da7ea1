"""Responsibilities p(k | y_n): estimated by a view predictor, corrected, and turned into views and heads."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import torch
from torch import Tensor

from .._random import derived_seed, generator_at
from .._types import UserError
from ..data.sampling import spread_rows


@dataclass(frozen=True)
class Estimator:
    """How predicted probabilities become the views and heads of images.

    Args:
        draw: assign the most probable view, or one drawn from the responsibilities.
        balance: how far the estimated view distribution is moved to the uniform one, 0 (not) to 1 (`balanced`).
        window: the observations go around in order, and the images were made by this many neighbouring ones, unknown
            which: only the window with the largest likelihood is used (default: no window).
        clusters: discriminator heads, from k-means of the responsibilities (default: one head a view).
        anywhere: share of the images, others each round, whose samples are projected in a view drawn uniformly; one
            more head judges them (default: none). Views that few images have are seldom shown to the other heads,
            and shapes may become anything there, such as boards that are right from one side. This head asks that
            they look like some image from any side.

    Examples:
        >>> import torch, unproject as up
        >>> estimator = up.Estimator("argmax", balance=1.0)
        >>> p = estimator.responsibilities(torch.tensor([[0.9, 0.1], [0.7, 0.3]]))
        >>> p.mean(0)
        tensor([0.5000, 0.5000])
        >>> estimator.assign(p, seed=0)
        (tensor([0, 1]), tensor([0, 1]))
    """

    draw: Literal["argmax", "posterior"] = "argmax"
    balance: float = 0.0
    window: int | None = None
    clusters: int | None = None
    anywhere: float | None = field(default=None, metadata={"described": "if given"})

    def __post_init__(self) -> None:
        if self.draw not in ("argmax", "posterior"):
            raise UserError(f"Estimator(draw={self.draw!r}): choose argmax or posterior")
        if not 0 <= self.balance <= 1:
            raise UserError(f"Estimator(balance={self.balance}): give 0 to 1")
        if not (self.anywhere is None or 0 < self.anywhere < 1):
            raise UserError(f"Estimator(anywhere={self.anywhere}): give more than 0 and less than 1, or None")
        for name in ("window", "clusters"):
            if (value := getattr(self, name)) is not None and value < 1:
                raise UserError(f"Estimator({name}={value}): give at least 1, or None")

    def heads(self, views: int) -> int:
        """Return how many heads a discriminator of images of so many views has."""
        return (self.clusters or views) + (self.anywhere is not None)

    def responsibilities(self, probabilities: Tensor) -> Tensor:
        """Return (N, K) probabilities within the likeliest window, balanced."""
        count = probabilities.shape[1]
        window = torch.arange(count) if self.window is None else likeliest_window(probabilities, self.window)
        inside = probabilities[:, window].clamp_min(1e-12)
        inside = inside / inside.sum(1, keepdim=True)
        if self.balance:
            inside = balanced(inside, self.balance)
        return torch.zeros_like(probabilities).index_copy(1, window, inside)

    def assign(self, responsibilities: Tensor, seed: int) -> tuple[Tensor, Tensor]:
        """Return (views, heads), (N,) each, of responsibilities (N, K)."""
        rng = generator_at(seed, 0, "choose")
        views = responsibilities.argmax(1)
        if self.draw == "posterior":
            views = torch.multinomial(responsibilities, 1, generator=rng)[:, 0]
        heads = views.clone() if self.clusters is None else k_means(responsibilities, self.clusters, seed)
        return views, heads


def uniform_views(images: int, views: int, seed: int) -> Tensor:
    """Draw a uniformly random view for every image, (images,)."""
    return torch.randint(views, (images,), generator=generator_at(seed, 0, "uniform ways"))


def balanced(probabilities: Tensor, balance: float, iterations: int = 50) -> Tensor:
    """Rescale the columns of (N, K) so that their means m become t ∝ m^(1 - balance); rows still sum to 1.

    Sinkhorn's iteration. Without it the estimate drifts: views that are predicted often are generated often, and then
    predicted more often still.
    """
    target = probabilities.mean(0).clamp_min(1e-6) ** (1 - balance)
    target = target / target.sum()
    for _ in range(iterations):
        probabilities = probabilities * (target / probabilities.mean(0).clamp_min(1e-12))
        probabilities = probabilities / probabilities.sum(1, keepdim=True)
    return probabilities


def likeliest_window(probabilities: Tensor, length: int) -> Tensor:
    """Return the `length` neighbouring views, (length,), around a circle, that make all images likeliest:

    argmax over windows W of Σ_n log Σ_{k in W} p(k | y_n).
    """
    count = probabilities.shape[1]
    windows = (torch.arange(count)[:, None] + torch.arange(min(length, count))) % count
    likelihood = [probabilities[:, window].sum(1).clamp_min(1e-9).log().mean() for window in windows]
    return windows[int(torch.stack(likelihood).argmax())]


def renumbered(labels: Tensor, before: Tensor, count: int) -> Tensor:
    """Return labels (N,) from 0 to count - 1, numbered so that as many items as possible have the label of before (N,).

    Else what a head has learned would be of another cluster after each round. Labels of before from `count` on are
    those of no cluster.

    Examples:
        >>> renumbered(torch.tensor([1, 1, 0, 2]), torch.tensor([0, 0, 2, 2]), 3)
        tensor([0, 0, 2, 1])
    """
    from scipy.optimize import linear_sum_assignment  # here, since it takes a tenth of a second to import

    known = before < count
    both = torch.zeros(count, count, dtype=torch.long)
    both.index_put_((labels[known].long(), before[known].long()), torch.tensor(1), accumulate=True)
    return torch.from_numpy(linear_sum_assignment(both.numpy(), maximize=True)[1])[labels]


SAMPLE = 2**16
"""Rows that clusters are found by; of more, so many evenly spread."""


def k_means(rows: Tensor, clusters: int, seed: int, starts: int = 5) -> Tensor:
    """Return the cluster of each row (N, D), (N,): scipy's k-means++, the best of several starts.

    Clusters are found by `SAMPLE` rows at most; all others belong to the nearest.
    """
    from scipy.cluster.vq import kmeans2, vq  # here, since they take a tenth of a second to import

    values = rows[spread_rows(len(rows), SAMPLE)].double().numpy()
    # k-means++ needs as many different rows as clusters; further clusters stay empty.
    clusters = min(clusters, len(np.unique(values, axis=0)))
    best: tuple[float, np.ndarray, np.ndarray] | None = None
    for start in range(starts):
        rng = np.random.default_rng(derived_seed(seed, start, "k-means"))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a cluster that runs empty keeps its centre
            centres, labels = kmeans2(values, clusters, minit="++", iter=50, rng=rng)
        error = float(np.square(values - centres[labels]).sum())
        if best is None or error < best[0]:
            best = error, centres, labels
    assert best is not None
    labels = best[2] if len(values) == len(rows) else vq(rows.double().numpy(), best[1])[0]
    return torch.from_numpy(labels.astype(np.int64))
