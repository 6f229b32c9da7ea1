"""Predicted: views are unknown; a view predictor, trained on the generator's own projections, assigns them (VP-MP-GAN).

Rounds alternate: train the generator; fit the predictor to projections of samples at uniform views; assign every real
image by its responsibilities p(k | y). A sample is projected in the view of the real image that it is paired with, so
the view distribution of samples is the predicted one.

References:
    Li et al. 2019; schedule and clusters from the authors' released implementation.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import torch
from torch import Tensor

from .._random import derived_seed, generator_at, seeded
from .._types import UserError
from ..data import Collection
from ..metrics import Finding, Score
from ..projections.observation import Observation
from .context import Context
from .panel import Assignment, AssignmentState, Panel
from .predictor import CHUNK, VIEWS_PER_SAMPLE, PredictorFit
from .responsibilities import Estimator, uniform_views
from .view_findings import are_found, entropy, information, view_findings
from .views import shared_collection

REPORT_EVERY, SAVE_EVERY = 20, 5000
"""Steps of a fit between two checks for a request to stop, and between two checkpoints."""
PREDICTED_AT_ONCE = 512

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
        return self.estimator.clusters or len(panel.observations)

    def begin(self, panel: Panel, seed: int) -> PredictedState:
        collection = shared_collection(panel.collections, panel.observations, "Predicted")
        views = uniform_views(len(collection), len(panel.observations), seed)
        return PredictedState(panel, views, torch.zeros_like(views), self, seed)


class PredictedState(AssignmentState):
    """The predictor, the rounds done, and the round whose predictor is being fitted, if any.

    Attributes:
        round: rounds done. `fitting`: the round in progress, or 0; `fitted`: steps of its fit that are done.
        last: the training step of the last round.
    """

    round: Tensor
    fitting: Tensor
    fitted: Tensor
    last: Tensor

    def __init__(self, panel: Panel, views: Tensor, heads: Tensor, settings: Predicted, seed: int) -> None:
        super().__init__(panel, views, heads)
        self.settings, self.seed = settings, seed
        self.predictor = self._new_predictor()
        self.adam: torch.optim.Adam | None = None
        for name in ("round", "fitting", "fitted", "last"):
            self.register_buffer(name, torch.tensor(0))

    def _new_predictor(self) -> torch.nn.Module:
        return self.settings.fit.network(self.panel.shape, len(self.panel.observations))

    def before_step(self, run: Context) -> bool:
        initialiser = self.settings.initialiser
        if initialiser is not None and run.step == 0 and self.round == 0 and not self.heads.any():  # none is assigned
            seed = derived_seed(self.seed, 0, "assignment")
            found = initialiser(self.panel.observations, torch.cat([part.floats() for part in self._parts()]), seed)
            self._assign(run, found, seed, event="initialised")
        if self.fitting:
            return self._continue_round(run)
        due, rounds = self.settings.rounds.due(run.progress), self.settings.rounds
        if due <= self.round or (self.round > 0 and run.step - self.last < rounds.least_steps):
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
        found = self.settings.estimator.responsibilities(self._probabilities())
        self._take(*self.settings.estimator.assign(found, derived_seed(self.seed, 0, "assignment")))
        return True

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
        found = self._responsibilities()
        self._assign(run, found, seed, event="assigned", round=int(self.fitting), loss=round(loss, 6))
        if self.settings.rounds.restart and self.round == 0:
            run.restart()
        self.round.copy_(self.fitting)
        self.last.fill_(run.step)
        self.fitting.fill_(0)
        self.adam = None
        return True

    def _responsibilities(self) -> Tensor:
        """Return the responsibilities that the images are assigned by, (N, K)."""
        return self.settings.estimator.responsibilities(self._probabilities())

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

    def _assign(self, run: Context, responsibilities: Tensor, seed: int, **fields: object) -> None:
        views, heads = self.settings.estimator.assign(responsibilities, seed)
        run.synchronise([views, heads])
        self._take(views, heads)
        counts = torch.bincount(self.views, minlength=len(self.panel.observations)).tolist()
        run.record(**fields, views=counts)

    def _take(self, views: Tensor, heads: Tensor) -> None:
        """Take over views and heads of the panel's images and of those held out."""
        count = len(self.panel)
        self.views.copy_(views[:count])
        self.heads.copy_(heads[:count])
        if self.panel.held_out is not None:
            self.held_out_heads.copy_(heads[count:])

    def optimisers(self) -> dict[str, torch.optim.Adam]:
        if self.fitting and self.adam is None:  # as after loading the state of an interrupted fit
            self.adam = self.settings.fit.optimiser(self.predictor)
        return {} if self.adam is None else {"adam": self.adam}

    def _parts(self) -> list[Collection]:
        """Return the panel's images, and those held out if there are any: views of both are predicted."""
        held_out = self.panel.held_out
        return [self.panel.collections[0], *([] if held_out is None else [held_out])]

    def _probabilities(self) -> Tensor:
        """Return the predictor's probabilities of the panel's images, then of those held out, (N + M, K)."""
        batches = (
            part.batch(rows) for part in self._parts() for rows in torch.arange(len(part)).split(PREDICTED_AT_ONCE)
        )
        return self.settings.fit.probabilities(self.predictor, batches)

    def view_probabilities(self) -> Tensor | None:
        return self._probabilities() if self.round > 0 else None

    def checks(self) -> dict[str, Score]:
        """Return what the predictor knows of views, I(k; y) = H(mean p) - mean H(p), and how many are used."""
        p = self._probabilities()[: len(self.panel)]
        n, count = p.shape
        used = torch.bincount(self.views, minlength=count) / n
        return {
            "view_information": Score(information(p), f"nats of log {count} = {math.log(count):.2f}, {n} images", n),
            "views_used": Score(entropy(used).exp().item(), f"exp of the entropy of assigned views, of {count}", n),
        }

    def merit(self) -> float:
        return information(self._probabilities())

    def estimates(self) -> Tensor:
        return self.views

    def findings(self, real: Tensor, generated: Tensor) -> list[Finding]:
        return view_findings(self._of(real), self._of(generated))

    def view_shares(self, real: Tensor) -> Tensor | None:
        """Return the mean probability of each view, before it is balanced."""
        p = self._of(real)
        return p.mean(0) if are_found(p) else None

    def _of(self, images: Tensor) -> Tensor:
        """Return the predictor's probabilities of images (N, ...), (N, K)."""
        self.predictor.eval()
        return self.settings.fit.probabilities(self.predictor, images.split(PREDICTED_AT_ONCE))
