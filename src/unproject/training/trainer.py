"""Trainer: one training step; read `step` top to bottom.

A step is a function of the state and of (seed, step) alone, so a run killed at any instant and resumed gives the
numbers of one never killed, as long as the budget is in steps; a budget in minutes depends on the clock.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .._random import derived_seed, generator_at, seed_globally
from ..adversarial.penalties import Penalty
from ..data.sampling import batch_rows
from . import checkpoint
from .balancing import Term, balanced_loss
from .batch import Batch
from .budget import stored_of
from .choosing import choose
from .distribution import Distribution
from .graphs import Graphs, can_compile, replayable
from .health import EVERY, check, check_finite, diversity
from .overfitting import adapt, held_out_logits
from .pace import SLOWER, Pace
from .recipe import Recipe
from .recorder import Recorder
from .run_directory import VERDICT
from .state import PanelState, State
from .training_context import TrainingContext

SLOW = 10.0  # seconds of a step from which on a stop request is obeyed within it


class Interrupted(Exception):
    """A step was left in its middle; `Trainer.undo` returns to its start."""


class Trainer:
    """A run in progress: the state, and how a step changes it.

    Args:
        recipe: what to train.
        out: the run directory.
        recorder: writes the log (and shows the progress).
        state: of the run (default: a new one).
        distribution: over processes and devices (default: this process alone).
        stopping: says whether the run was asked to stop.
    """

    def __init__(
        self,
        recipe: Recipe,
        out: Path,
        recorder: Recorder,
        state: State | None = None,
        distribution: Distribution | None = None,
        stopping: Callable[[], bool] = lambda: False,
    ) -> None:
        self.recipe, self.out, self.recorder = recipe, out, recorder
        self.distribution = distribution or Distribution()
        self.state = state or State(recipe, self.distribution.device)
        self.asked_to_stop = stopping
        self.graphs = Graphs(enabled=recipe.normalise_over != "processes")
        self.forward = self._compiled()
        self.began = time.monotonic() - self.state.counters.seconds
        self.saved = stored_of(recipe, self.state.counters) if self.state.counters.step else None
        self.last_seconds, self.pace = math.inf, Pace()
        self.before: dict[str, Tensor] | None = None

    def step(self) -> None:
        """Take one training step; without one, return early if asked to stop while images are assigned.

        Raises:
            Interrupted: if asked to stop within a step that takes long; the state is that of half a step.
        """
        recipe, state = self.recipe, self.state
        progress = self.progress()
        seed_globally(recipe.seed, state.counters.step, "choice")  # for layers that draw, such as dropout
        if choose(state, progress, self.distribution.copy_from_leader, self.record):
            self.forward = self._compiled()
        if not self._assign(progress):
            return
        seed_globally(recipe.seed, state.counters.step, f"layers/{self.distribution.rank}")
        began = time.monotonic()
        self._remember()
        self._set_rates(progress)
        losses: dict[str, Tensor] = {}
        for i in range(recipe.discriminator_steps):
            draw = state.counters.step * recipe.discriminator_steps + i
            with torch.set_grad_enabled(i == recipe.discriminator_steps - 1):  # the last draw updates the generator too
                x = self._generate(self._codes(draw))
                batches = self._project(x, draw)
            losses |= self._update_discriminators(batches, draw, progress)
        losses["loss_g"] = self._update_generator(x, batches, progress)
        self.last_seconds = time.monotonic() - began
        if (times := self.pace.add(self.last_seconds)) and state.device.type == "cpu" and torch.get_num_threads() > 1:
            self.recorder.say(SLOWER.format(times))
        self._finish_step(progress, losses, batches)

    def _remember(self) -> None:
        """Keep the state that an interruption returns to, if steps are slow or this is the first."""
        slow = self.distribution.agree(self.last_seconds > SLOW)  # all processes check, or none
        self.before = self.state.tensors() if slow else None

    def _check_stop(self) -> None:
        """Leave a slow step if asked to stop."""
        if self.before is not None and self.stopping():
            raise Interrupted

    def undo(self) -> None:
        """Return to the start of the step that was interrupted."""
        assert self.before is not None
        self.state.load(self.before)
        self.saved = None

    def _codes(self, draw: int) -> Tensor:
        rng = generator_at(self.recipe.seed, draw, "codes/0")
        whole = self.state.generator.draw(self.distribution.world * self.recipe.samples, rng)
        return self.distribution.own(whole).to(self.state.device)

    def _generate(self, code: Tensor) -> Tensor:
        with self._autocast():
            return self.forward(code).float()

    def _project(self, x: Tensor, draw: int) -> list[Batch]:
        """Pair samples, each as often as it is projected, with real images, in every panel."""
        each = self.state.domain.repeated(x, self.recipe.views_per_sample)
        return [self._batch(panel, each, draw, index) for index, panel in enumerate(self.state.panels)]

    def _batch(self, panel: PanelState, x: Tensor, draw: int, index: int) -> Batch:
        self._check_stop()
        recipe, ranks = self.recipe, self.distribution
        whole = batch_rows(len(panel.panel), recipe.batch * ranks.world, derived_seed(recipe.seed, index, "rows"), draw)
        rows = ranks.own(whole)
        panel.assignment.call = self.graphs.projecting(index)
        fake = panel.assignment.project(x, rows, ranks.part(recipe.seed, draw, f"latents/{index}", whole))
        real, seen = panel.panel.batch(rows, fake.device).to(fake), fake
        if panel.augmentation is not None:
            rng = ranks.part(recipe.seed, draw, f"augmentation/{index}")
            real, fake = panel.augmentation(real, rng), panel.augmentation(fake, rng)
        return Batch(panel, real, fake, panel.assignment.heads[rows].long().to(fake.device), rows, seen)

    def _update_discriminators(self, batches: list[Batch], draw: int, progress: float) -> dict[str, Tensor]:
        recipe, state = self.recipe, self.state
        state.let_discriminators_learn(True)
        penalise = recipe.penalty is not None and draw % recipe.penalty.every == recipe.penalty.every - 1
        total, penalty = torch.zeros((), device=state.device), torch.zeros((), device=state.device)
        for index, batch in enumerate(batches):
            self._check_stop()
            with self._autocast():
                # One concatenated forward: batch statistics see both kinds of image, spectral vectors move once.
                images = torch.cat([batch.real, batch.fake.detach()])
                logits = self.graphs(batch.panel.discriminator, images, batch.head.repeat(2))
                held_out = held_out_logits(batch.panel, recipe, draw, index, self.distribution)
            real, fake = logits.float().chunk(2)
            total = total + recipe.loss.discriminator(real, fake)
            batch.real_logits = real.detach()
            if held_out is not None:
                adapt(batch.panel, (real, held_out, fake), progress, self.distribution)
            if penalise and recipe.penalty is not None:
                found = self._penalty(recipe.penalty, batch, draw, index)
                penalty = penalty + batch.panel.penalty_scale * found
        self._apply(state.discriminators, state.discriminator_optimiser, total + penalty)
        return {"loss_d": total.detach()} | ({"penalty": penalty.detach()} if penalise else {})

    def _penalty(self, penalty: Penalty, batch: Batch, draw: int, index: int) -> Tensor:
        """Return the gradient penalty of a panel."""
        rng, module = self.distribution.part(self.recipe.seed, draw, f"penalty/{index}"), batch.panel.discriminator

        def of(real: Tensor, fake: Tensor, head: Tensor) -> Tensor:
            return penalty(lambda images: module(images, head), real, fake, rng)

        inputs = batch.real, batch.fake.detach(), batch.head
        known = replayable(penalty) and replayable(module)
        return self.graphs.replayed("penalty", of, inputs, module) if known else of(*inputs)

    def _update_generator(self, x: Tensor, batches: list[Batch], progress: float) -> Tensor:
        recipe, state = self.recipe, self.state
        # The discriminators' own gradients are not needed here; without them the pass takes a third less.
        state.let_discriminators_learn(False)
        terms = []
        for index, batch in enumerate(batches):
            self._check_stop()
            with self._autocast():
                fake = self.graphs(batch.panel.discriminator, batch.fake, batch.head)
            weight, matching = batch.panel.panel.weight, batch.panel.matching
            terms.append(Term(weight, recipe.loss.generator(batch.real_logits, fake.float()), batch.panel))
            if matching is not None and matching.due(state.counters.step):
                found = matching(batch.seen, self.distribution.mean, partial(self.graphs.replayed, index))
                terms.append(Term(weight * matching.weight_at(progress), found, matching))
        due = recipe.balance_every > 0 and state.counters.step % recipe.balance_every == 0
        unknown = recipe.balance_every > 0 and any(term.owner.gradient_norm == 0 for term in terms)
        measure = len(terms) > 1 and (due or unknown)
        total, loss = balanced_loss(state, terms, self.distribution if measure else None)
        extra = recipe.regulariser(x, progress) if recipe.regulariser else 0.0
        for batch in batches:
            with self._autocast():
                extra = extra + batch.panel.assignment.loss(batch.fake, batch.rows, progress)
        self._apply(state.generator, state.generator_optimiser, loss + extra)
        for panel in state.panels:
            panel.update(self.distribution)
        return total

    def _apply(self, module: torch.nn.Module, optimiser: torch.optim.Optimizer, loss: Tensor) -> None:
        optimiser.zero_grad()
        loss.backward()
        self.distribution.average_gradients(module)
        optimiser.step()

    def _finish_step(self, progress: float, losses: dict[str, Tensor], batches: list[Batch]) -> None:
        """Average the weights, and now and then check, log and save."""
        counters = self.state.counters
        counters.step += 1
        self.state.update_average(self.recipe.ema_half_life)
        counters.seconds = self.seconds
        if counters.step % EVERY == 0:
            numbers = {name: self.distribution.average(float(value)) for name, value in losses.items()}
            ratio = self.distribution.average(max(diversity(b.real, b.fake.detach()) for b in batches))
            counters.collapsed = check(counters.step, numbers, ratio, counters.collapsed, counters.began)
            self.record(**{k: round(v, 6) for k, v in numbers.items()}, **self._panel_log())
            self.recorder.show(progress, f"step {counters.step}")
        if counters.step % self.recipe.checkpoint_every == 0:
            self.save()

    def _panel_log(self) -> dict[str, Any]:
        """Return the fields of assignments and augmentations, those of further panels with the panel's number."""
        logs = [panel.log() for panel in self.state.panels]
        return {(f"{name}/{i}" if i else name): value for i, log in enumerate(logs) for name, value in log.items()}

    def _assign(self, progress: float) -> bool:
        """Let each panel's assignment act; False if one was interrupted."""
        for index, panel in enumerate(self.state.panels):
            # Without the rank: each process fits the same predictor.
            seed_globally(self.recipe.seed, self.state.counters.step, f"assignment/{index}")
            if panel.assignment.learned is not None:
                panel.assignment.learned.advance(progress)
            if not panel.assignment.before_step(TrainingContext(self, progress, index)):
                self.saved = None
                return False
        return True

    @property
    def seconds(self) -> float:
        """Seconds that training has taken, those before it was resumed among them."""
        return time.monotonic() - self.began

    def progress(self) -> float:
        """Return the part of the budget spent, by the mean of the processes' clocks, so that all agree.

        Steps are the same in all of them: a mean would be rounded, and rounds would come a step late.
        """
        return self.recipe.progress(self.state.counters.step, self.distribution.average(self.seconds))

    def stopping(self) -> bool:
        """Whether any process was asked to stop, so that all stop at the same instant."""
        return self.distribution.agree(self.asked_to_stop())

    def record(self, **fields: Any) -> None:
        """Write a line to the log."""
        self.state.counters.seconds = self.seconds
        self.recorder.write(self.state.counters.step, self.state.counters.seconds, **fields)

    def restart(self) -> None:
        """Start generator and discriminators from new weights."""
        self.state.restart()
        self.forward = self._compiled()

    def save(self) -> None:
        """Write a checkpoint and a picture, unless they are there. Raises Diverged if anything is not finite."""
        counters = self.state.counters
        counters.seconds = self.distribution.average(self.seconds)
        if self.saved == stored_of(self.recipe, counters):
            return
        counters.lines = self.recorder.lines
        tensors = self.state.tensors()
        samples = self.state.sampler().sample(self.state.domain.previewed, seed=0)
        check_finite(counters.step, tensors | {"a sample": samples}, self.distribution.agree)
        if self.distribution.leads:
            self.recorder.synchronise()
            checkpoint.save(self.out / "checkpoints", counters.step, tensors)
            (self.out / VERDICT).unlink(missing_ok=True)  # it is of fewer steps
            self.state.domain.write_preview(samples, self.out / "samples" / f"step-{counters.step:09d}.png")
        self.distribution.barrier()
        self.saved = stored_of(self.recipe, counters)

    def _compiled(self) -> Callable[[Tensor], Tensor]:
        """Compile the generator if asked for and possible."""
        generator, wanted = self.state.generator, self.recipe.compile and can_compile(self.state.device)
        self.graphs.forget()
        return torch.compile(generator) if wanted else partial(self.graphs, generator)

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.state.device.type, torch.bfloat16, enabled=self.recipe.precision == "bfloat16")

    def _set_rates(self, progress: float) -> None:
        state, recipe = self.state, self.recipe
        for optimiser, settings in (
            (state.generator_optimiser, recipe.generator_optimiser),
            (state.discriminator_optimiser, recipe.discriminator_optimiser),
        ):
            optimiser.param_groups[0]["lr"] = settings.rate_at(progress) * state.counters.rate_scale
