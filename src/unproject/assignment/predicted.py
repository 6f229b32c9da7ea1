"""Predicted: views are unknown; a view predictor, trained on the generator's own projections, assigns them (VP-MP-GAN).

Rounds alternate: train the generator; fit the predictor to projections of samples at uniform views; assign every real
image by its responsibilities p(k | y). A sample is projected in the view of the real image that it is paired with, so
the view distribution of samples is the predicted one.

References:
    Li et al. 2019; schedule and clusters from the authors' released implementation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import torch
from torch import Tensor

from .._random import derived_seed, generator_at, seeded
from .._types import UserError
from ..projections.observation import Observation
from .context import Context
from .panel import Assignment, Panel
from .predicting import PredictingState
from .predictor import CHUNK, VIEWS_PER_SAMPLE, PredictorFit
from .responsibilities import Estimator, renumbered
from .starting import views_at_start

REPORT_EVERY, SAVE_EVERY = 20, 5000
"""Steps of a fit between two checks for a request to stop, and between two checkpoints."""

Initialiser = Callable[[Sequence[Observation], Tensor, int], Tensor]
"""(observations, images (N, ...), seed) → responsibilities (N, K) for round 0."""


@dataclass(frozen=True)
class Rounds:
    """When views are predicted anew.

    Args:
        starts: the part of the budget at which each round starts, increasing within (0, 1).
        least_steps: training steps between two rounds at least; in a short run rounds that come sooner are left out.
        restart: start the generator and the discriminator from new weights after round 1, as the released code does.

    Examples:
        >>> import unproject as up
        >>> up.Rounds((0.2, 0.5, 0.8)).due(progress=0.6)
        2
    """

    starts: tuple[float, ...] = (0.2, 0.4, 0.6, 0.8)
    least_steps: int = 0
    restart: bool = False

    def __post_init__(self) -> None:
        if list(self.starts) != sorted(set(self.starts)) or not all(0 < s < 1 for s in self.starts):
            raise UserError(f"Rounds(starts={self.starts}): give increasing parts of the budget between 0 and 1")

    def due(self, progress: float) -> int:
        """Return how many rounds should have started by then."""
        return sum(start <= progress for start in self.starts)


@dataclass(frozen=True)
class Predicted(Assignment):
    """Assign views in rounds by a view predictor; in round 0 views are random, or an initialiser's.

    Args:
        rounds: when views are predicted anew.
        fit: the view predictor and how it is fitted.
        estimator: how predicted probabilities become views and heads.
        initialiser: gives responsibilities for round 0 (default: none, uniformly random views and one head).

    Examples:
        >>> import unproject as up
        >>> views = up.projections.azimuth_bins(4, up.Silhouette(size=16))
        >>> silhouettes = up.data.observe(up.data.chairs(6, 16), views)
        >>> assignment = up.Predicted(up.Rounds((0.5,)), estimator=up.Estimator("posterior", balance=0.8))
        >>> panel = up.Panel(views, silhouettes, assignment)
        >>> panel.assignment.begin(panel, seed=0).estimates().shape
        torch.Size([6])
    """

    projected_at_once: ClassVar[int] = CHUNK
    rounds: Rounds = field(default_factory=Rounds)
    fit: PredictorFit = field(default_factory=PredictorFit)
    estimator: Estimator = field(default_factory=Estimator)
    initialiser: Initialiser | None = None

    def heads(self, panel: Panel) -> int:
        return self.estimator.heads(len(panel.observations))

    def begin(self, panel: Panel, seed: int) -> PredictedState:
        return PredictedState(panel, *views_at_start(panel, seed, "Predicted"), self, seed)


class PredictedState(PredictingState):
    """The predictor, the rounds done, and the round whose predictor is being fitted, if any.

    Attributes:
        round: number of the last round done, 0 before the first; a larger budget begins with other numbers, see
            `_number_anew`. `fitting`: the round in progress, or 0; `fitted`: steps of its fit that are done.
        last: the training step of the last round.
    """

    settings: Predicted
    round: Tensor
    fitting: Tensor
    fitted: Tensor
    last: Tensor

    def __init__(self, panel: Panel, views: Tensor, heads: Tensor, settings: Predicted, seed: int) -> None:
        super().__init__(panel, views, heads, settings)
        mirrored, count = settings.fit.mirrored, len(panel.observations)
        if mirrored is not None and sorted(mirrored) != list(range(count)):
            raise UserError(f"PredictorFit(mirrored={mirrored}): give each of 0 to {count - 1}, the observations, once")
        self.seed = seed
        self.predictor = self._new_predictor()
        self.adam: torch.optim.Adam | None = None
        self.begun = False
        for name in ("round", "fitting", "fitted", "last"):
            self.register_buffer(name, torch.tensor(0))

    def _new_predictor(self) -> torch.nn.Module:
        return self.settings.fit.network(self.panel.shape, len(self.panel.observations))

    def estimates(self) -> Tensor:
        return super().estimates() if self.round > 0 else self.views.long()

    def view_probabilities(self) -> Tensor | None:
        return self._probabilities() if self.round > 0 else None

    def before_step(self, run: Context) -> bool:
        initialiser, begun, self.begun = self.settings.initialiser, self.begun, True
        if initialiser is not None and not begun and self.round == 0 and not self.heads.any():  # none is assigned
            seed, rows = derived_seed(self.seed, 0, "assignment"), self._upcoming(run)
            items = torch.cat([self._kept(rows).floats(), *(part.floats() for part in self._held_out())])
            self._assign(run, initialiser(self.panel.observations, items, seed), rows, seed, event="initialised")
        if self.fitting:
            return self._continue_round(run)
        self._number_anew(run.progress)
        due, rounds = self._number_due(run.progress), self.settings.rounds
        if due <= self.round or (self.round > 0 and run.step - self.last < rounds.least_steps):
            self._cover_what_is_left(run)
            return True
        self._begin_round(due, run)
        return self._continue_round(run)

    def take_over(self, tensors: dict[str, Tensor]) -> bool:
        """Take over a fitted predictor of the same shape, and assign the images by it at once.

        Raises:
            UserError: if round 1 throws the networks away.
        """
        if self.settings.rounds.restart:
            raise UserError("this recipe starts from new weights after round 1; take one without Rounds(restart=True)")
        prefix = "predictor."
        stored = {name.removeprefix(prefix): v for name, v in tensors.items() if name.startswith(prefix)}
        shapes = {name: v.shape for name, v in stored.items()}
        own = {name: v.shape for name, v in self.predictor.state_dict().items()}
        if shapes != own or not tensors["round"] > 0:
            return False
        self.predictor.load_state_dict(stored)
        seed, rows = derived_seed(self.seed, 0, "assignment"), self._measured()
        found = self._responsibilities(self._probabilities(rows))
        self._take(*self.settings.estimator.assign(found, seed), rows, seed)
        if self.coverage is not None:
            self.coverage.expire()
        return True

    def _number_anew(self, progress: float) -> None:
        """Raise the numbers of rounds if the budget has grown.

        A run that goes on with a larger budget is less far than it was: it goes through the rounds of its budget again,
        by numbers that none of them had, since seeds follow from numbers.
        """
        due, count = self.settings.rounds.due(progress), len(self.settings.rounds.starts) + 1
        before, done = divmod(int(self.round), count)
        if due < done:
            self.round.fill_((before + 1) * count + due)

    def _number_due(self, progress: float) -> int:
        """Return the number of the last round that should have started by then."""
        count = len(self.settings.rounds.starts) + 1
        return int(self.round) // count * count + self.settings.rounds.due(progress)

    def _begin_round(self, due: int, run: Context) -> None:
        if self.settings.fit.fresh:
            with seeded(self.seed, f"predictor/{due}"):
                self.predictor = self._new_predictor().to(run.device)
        self.adam = self.settings.fit.optimiser(self.predictor)
        self.fitting.fill_(due)
        self.fitted.fill_(0)

    def _continue_round(self, run: Context) -> bool:
        """Fit the predictor and assign the images; False if interrupted before the end."""
        run.synchronise([*run.generator.parameters(), *run.generator.buffers()])
        seed = derived_seed(self.seed, int(self.fitting), "assignment")
        loss = self._fit(run, seed)
        if loss is None:
            return False
        rows = self._upcoming(run)
        found = self._responsibilities(self._predicted(run, rows))
        self._assign(run, found, rows, seed, event="assigned", round=int(self.fitting), loss=round(loss, 6))
        if self.settings.rounds.restart and self.round == 0:
            run.restart()
        self.round.copy_(self.fitting)
        self.last.fill_(run.step)
        self.fitting.fill_(0)
        self.adam = None
        return True

    def _responsibilities(self, p: Tensor) -> Tensor:
        """Return the responsibilities that images are assigned by, of their probabilities p (N, K)."""
        return self.settings.estimator.responsibilities(p)

    def _upcoming(self, run: Context) -> Tensor | None:
        """Return the rows that are drawn before the next round; None for all, if they are not too many."""
        if self.coverage is None:
            return None
        rounds = self.settings.rounds
        later = [start for start in rounds.starts if start > run.progress]
        return self.coverage.extend(run, min(later, default=1.0), rounds.least_steps)

    def _cover_what_is_left(self, run: Context) -> None:
        """Predict further images if more are drawn than the last round foresaw; an initialiser is not asked again."""
        initialised = self.round == 0 and self.settings.initialiser is not None
        if self.coverage is not None and not initialised and self.coverage.is_left(run):
            rows = self._upcoming(run)
            found = self._responsibilities(self._predicted(run, rows))
            seed = derived_seed(self.seed, run.step, "further images")
            self._assign(run, found, rows, seed, event="assigned", round=int(self.round))

    def _fit(self, run: Context, seed: int) -> float | None:
        """Return the last loss of the predictor's fit, or None if interrupted."""
        fit, adam = self.settings.fit, self.adam
        assert adam is not None
        report = run.subtask("view predictor", fit.steps)
        images, views = self._labelled(run, seed)
        loss = torch.tensor(float("nan"))
        for done, loss in fit.run(self.predictor, adam, images, views, seed, int(self.fitted)):
            self.fitted.fill_(done)
            if done < fit.steps and done % REPORT_EVERY == 0:
                report(done, loss.item())
                if done % SAVE_EVERY == 0:
                    run.save()
                if run.stopping():
                    return None
        report(fit.steps, loss.item())
        return loss.item()

    @torch.no_grad()
    def _labelled(self, run: Context, seed: int) -> tuple[Tensor, Tensor]:
        """Project samples in uniform views; return the projections and their views. Each sample is projected often."""
        projections, views = [], []
        for start in range(0, self.settings.fit.images, CHUNK):
            rng = generator_at(seed, start, "labelled projections")
            x = run.generator(run.generator.draw(CHUNK // VIEWS_PER_SAMPLE, rng).to(run.device))
            views.append(torch.randint(len(self.panel.observations), (CHUNK,), generator=rng))
            projections.append(self.observe(x.repeat_interleave(VIEWS_PER_SAMPLE, 0), views[-1], rng))
        count = self.settings.fit.images
        return torch.cat(projections)[:count], torch.cat(views)[:count]

    def _assign(self, run: Context, responsibilities: Tensor, rows: Tensor | None, seed: int, **fields: object) -> None:
        views, heads = self.settings.estimator.assign(responsibilities, seed)
        if clusters := self.settings.estimator.clusters:  # which k-means numbers anew
            held_out = [] if self.panel.held_out is None else [self.held_out_heads]
            before = torch.cat([self.heads if rows is None else self.heads[rows], *held_out])
            heads = renumbered(heads, before, clusters)
        run.synchronise([views, heads])
        self._take(views, heads, rows, seed)
        counts = torch.bincount(self.views, minlength=len(self.panel.observations)).tolist()
        run.record(**fields, views=counts)

    def optimisers(self) -> dict[str, torch.optim.Adam]:
        if self.fitting and self.adam is None:  # as after loading the state of an interrupted fit
            self.adam = self.settings.fit.optimiser(self.predictor)
        return {} if self.adam is None else {"adam": self.adam}
