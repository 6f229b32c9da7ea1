"""PredictingState: what a view predictor says of a panel's images: of all, or of some of many."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from typing import Protocol

import torch
from torch import Tensor, nn

from .._random import generator_at, rows_of_all
from .._types import Diverged
from ..data import Collection
from ..data.sampling import spread_rows
from ..metrics import Finding, Score
from .context import Context
from .coverage import MEASURED, WHOLE, Coverage, spread_over
from .panel import AssignmentState, Panel
from .predictor import PredictorFit
from .responsibilities import Estimator
from .view_findings import are_found, entropy, information, view_findings

PREDICTED_AT_ONCE = 512


class PredictingSettings(Protocol):
    """What `Predicted` says of predictors: how one is fitted, and how its probabilities become views and heads."""

    @property
    def fit(self) -> PredictorFit: ...

    @property
    def estimator(self) -> Estimator: ...


class PredictingState(AssignmentState):
    """A view predictor, and the views and heads that it assigned.

    Attributes:
        predictor: image → logits of the views.
        sampled: (N,) the view that samples paired with an image are projected in, if `Estimator.anywhere` is given:
            that of the image, or any.
        coverage: the images that it has predicted, if there are more than `WHOLE`.
    """

    predictor: nn.Module
    sampled: Tensor

    def __init__(self, panel: Panel, views: Tensor, heads: Tensor, settings: PredictingSettings) -> None:
        super().__init__(panel, views, heads)
        self.settings = settings
        self.coverage = Coverage() if len(panel) > WHOLE else None
        if settings.estimator.anywhere is not None:
            self._counts["sampled"] = self._counts["views"]
            self.register_buffer("sampled", self.views.clone())

    def project(self, x: Tensor, rows: Tensor, rng: torch.Generator) -> Tensor:
        return self.observe(x, self._views_of_samples(rows_of_all(rng, rows)), rng)

    def _views_of_samples(self, rows: Tensor) -> Tensor:
        """Return the views that samples are projected in that are paired with the images of `rows`."""
        return (self.views if self.settings.estimator.anywhere is None else self.sampled)[rows].long()

    def _predicted(self, run: Context, rows: Tensor | None) -> Tensor:
        """Return the probabilities of these rows, then of those held out: of many, each process predicts a part.

        Raises:
            Diverged: in all processes, if one is not finite, as after a generator that is not has made the projections.
        """
        run.synchronise(self.predictor.state_dict().values())  # each process has moving statistics of its own
        if rows is None:
            p = self._probabilities()
        else:
            fit, predictor = self.settings.fit, self.predictor
            p = run.shared(rows, lambda some: fit.probabilities(predictor, _batches(self.panel.collections[0], some)))
            p = torch.cat([p, *(fit.probabilities(predictor, _batches(part)) for part in self._held_out())])
        finite = p.isfinite().all().float()
        run.synchronise([finite])
        if not finite:
            raise Diverged(
                f"training broke down by step {run.step}: predicted views are not finite; lower the learning rate"
            )
        return p

    def _take(self, views: Tensor, heads: Tensor, rows: Tensor | None, seed: int) -> None:
        """Take over views and heads of these rows, or of all the panel's images, and of those held out."""
        count = len(self.panel) if rows is None else len(rows)
        for own, found in ((self.views, views[:count]), (self.heads, heads[:count])):
            rng = generator_at(seed, 0, "others")  # the same for both, so that heads are those of the views
            own.copy_(found if rows is None else spread_over(found, rows, len(self.panel), rng))
        if self.panel.held_out is not None:
            self.held_out_heads.copy_(heads[count:])
        if self.settings.estimator.anywhere is not None:
            self._look_anywhere(self.settings.estimator.anywhere, generator_at(seed, 0, "anywhere"))

    def _look_anywhere(self, share: float, rng: torch.Generator) -> None:
        """Choose a share of the images whose samples are projected in any view, for the last head."""
        count = len(self.panel.observations)
        chosen = torch.rand(len(self.panel), generator=rng) < share
        views = torch.randint(count, (len(self.panel),), generator=rng, dtype=self.views.dtype)
        self.sampled.copy_(torch.where(chosen, views, self.views))
        last = self.settings.estimator.heads(count) - 1
        self.heads.masked_fill_(chosen, last)
        if self.panel.held_out is not None:  # as many, since losses leave each head's offset free
            self.held_out_heads.masked_fill_(torch.rand(len(self.panel.held_out), generator=rng) < share, last)

    def _held_out(self) -> list[Collection]:
        """Return the images that are held out, if there are any: their views are predicted too."""
        return [] if self.panel.held_out is None else [self.panel.held_out]

    def _kept(self, rows: Tensor | None) -> Collection:
        """Return the panel's images of these rows, or all."""
        whole = self.panel.collections[0]
        return whole if rows is None else whole.subset(rows)

    def _probabilities(self, rows: Tensor | None = None) -> Tensor:
        """Return the predictor's probabilities of these rows, or of all images, then of those held out, (N + M, K)."""
        parts = [_batches(self.panel.collections[0], rows), *map(_batches, self._held_out())]
        return self.settings.fit.probabilities(self.predictor, chain.from_iterable(parts))

    def _measured(self) -> Tensor | None:
        """Return the rows that scores are measured on: None for all, or some of many, evenly spread."""
        return None if self.coverage is None else spread_rows(len(self.panel), MEASURED)

    def checks(self) -> dict[str, Score]:
        """Return what the predictor knows of views, I(k; y) = H(mean p) - mean H(p), and how many are used."""
        rows, whole = self._measured(), len(self.panel)
        n = whole if rows is None else len(rows)
        p = self._probabilities(rows)[:n]
        count, of = p.shape[1], "" if rows is None else f" spread over {whole}"
        used = torch.bincount(self.views, minlength=count) / whole
        says = f"nats of log {count} = {math.log(count):.2f}, {n} images{of}"
        return {
            "view_information": Score(information(p), says, n),
            "views_used": Score(entropy(used).exp().item(), f"exp of the entropy of assigned views, of {count}", whole),
        }

    def merit(self) -> float:
        return information(self._probabilities(self._measured()))

    def estimates(self) -> Tensor:
        """Return the most probable view of each image, by the window of views that is used, but not balanced."""
        rows = self._measured()
        estimator = replace(self.settings.estimator, balance=0.0)
        found = torch.full((len(self.panel),), -1)
        measured = torch.arange(len(self.panel)) if rows is None else rows
        found[measured] = estimator.responsibilities(self._probabilities(rows))[: len(measured)].argmax(1)
        return found

    def findings(self, real: Tensor, generated: Tensor) -> list[Finding]:
        silhouettes = real if self.panel.projection.silhouettes else None
        return view_findings(self._of(real), self._of(generated), silhouettes)

    def view_shares(self, real: Tensor) -> Tensor | None:
        """Return the mean probability of each view, before it is balanced."""
        p = self._of(real)
        return p.mean(0) if are_found(p) else None

    def _of(self, images: Tensor) -> Tensor:
        """Return the predictor's probabilities of images (N, ...), (N, K)."""
        self.predictor.eval()
        return self.settings.fit.probabilities(self.predictor, images.split(PREDICTED_AT_ONCE))


def _batches(images: Collection, rows: Tensor | None = None) -> Iterator[Tensor]:
    """Yield these rows, or all, a few at a time."""
    rows = torch.arange(len(images)) if rows is None else rows
    return (images.batch(some) for some in rows.split(PREDICTED_AT_ONCE))
