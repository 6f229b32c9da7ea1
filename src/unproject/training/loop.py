"""The training loop: read `train` top to bottom.

A step is a function of the state and of (seed, step) alone, so a run killed at any instant and resumed gives
the numbers of one never killed, as long as the budget is in steps; a budget in minutes depends on the clock.
"""

from __future__ import annotations

import os
import shutil
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType

import torch
from torch import Tensor

from .._random import derived_seed, generator_at
from ..adversarial.assignment import FirstGuess, Predicted, choose_ways, estimated, fit, k_means, predict
from ..adversarial.learned_prior import LearnedPrior
from . import checkpoint, run_directory
from .distribution import Distribution
from .health import EVERY, Diverged, check, check_finite, diversity
from .panel import Panel, panel_rng
from .pictures import save_samples
from .recipe import Recipe
from .recorder import Recorder
from .run_directory import Origin, Run
from .state import State

PREDICTOR_CHUNK, LOOKS = 256, 4
FIT_REPORTS, FIT_SAVES = 20, 5000
"""Steps of a view predictor between two looks at whether to stop, and between two checkpoints."""


def train(
    recipe: Recipe, out: str | Path, *, origin: Origin | None = None, device: str = "auto", quiet: bool = False
) -> Run:
    """Train a recipe from the start into a new run directory and return the run.

    Raises:
        UserError: if `out` holds a run already, or training diverges twice.
        OSError: if the disk is full; checkpoints already written stay good.
    """
    distribution = Distribution(device)
    out = Path(out)
    run_directory.check_free(out)
    state = State(recipe, distribution.device)  # before anything is written: a part may refuse its arguments
    distribution.barrier()
    if distribution.leads:
        run_directory.create(out, recipe, origin)
    with run_directory.locked(out, distribution.leads):
        return _run(recipe, out, state, distribution, quiet)


def resume(recipe: Recipe, out: str | Path, *, device: str = "auto", quiet: bool = False) -> Run:
    """Go on with a run from its newest checkpoint; `recipe` must be the run's, a larger budget aside."""
    distribution = Distribution(device)
    out = Path(out)
    run_directory.check_same(out, recipe)
    state = State(recipe, distribution.device)
    with run_directory.locked(out, distribution.leads):
        if distribution.leads:
            run_directory.remove_temporaries(out)
        if checkpoint.list_checkpoints(out / "checkpoints"):
            state.load(checkpoint.load(checkpoint.newest(out / "checkpoints")))
        return _run(recipe, out, state, distribution, quiet)


def _run(recipe: Recipe, out: Path, state: State, distribution: Distribution, quiet: bool) -> Run:
    loop = Loop(recipe, out, state, distribution)
    with Recorder(out, state.counters.lines, distribution.leads, quiet) as recorder, stop_request() as stop:
        loop.recorder, loop.asked_to_stop = recorder, stop
        going = True
        while going:
            try:
                going = loop.progress() < 1 and not loop.stopping()
                if going:
                    loop.advance()
                else:
                    loop.save()
            except Diverged as trouble:
                loop.go_back(trouble)
                going = True
    distribution.close()
    return Run(out, state.average, state.counters.step)


class Loop:
    """A run in progress: the state and what is needed to advance it."""

    recorder: Recorder

    def __init__(self, recipe: Recipe, out: Path, state: State, distribution: Distribution) -> None:
        self.recipe, self.out, self.state, self.distribution = recipe, out, state, distribution
        self.forward = self._compiled()
        self.began = time.monotonic() - state.counters.seconds
        self.asked_to_stop: Callable[[], bool] = lambda: False
        self.saved = self._instant() if state.counters.step else None

    def _compiled(self) -> Callable[[Tensor], Tensor]:
        """The generator, compiled if that is asked for and can be done; torch needs a compiler on processors."""
        generator = self.state.generator
        possible = self.state.device.type == "cuda" or any(map(shutil.which, (os.environ.get("CXX", "g++"), "clang++")))
        return torch.compile(generator) if self.recipe.compile and possible else generator

    def progress(self) -> float:
        """The part of the budget spent; by the leading process's clock, so that all processes agree."""
        seconds = time.monotonic() - self.began
        return self.distribution.average(self.recipe.progress(self.state.counters.step, seconds))

    def stopping(self) -> bool:
        """Whether any process was asked to stop, so that all stop at the same instant."""
        return self.distribution.agree(self.asked_to_stop())

    def _instant(self) -> tuple[int, int]:
        return self.state.counters.step, self.state.counters.fitted

    def advance(self) -> None:
        """One step, with whatever is due before and after it; less, if it is asked to stop amid an assignment."""
        counters = self.state.counters
        progress = self.progress()
        assignment = self.recipe.assignment
        if isinstance(assignment, Predicted):
            if assignment.first is not None and counters.step == counters.round == 0:
                self.guess(assignment, assignment.first)
            due = counters.fitting or sum(start <= progress for start in assignment.starts)
            if due > counters.round and not self.assign(assignment, due):
                return
        self._set_rates(progress)
        losses, real, fake = self._step(progress)
        counters.step += 1
        self.state.update_average(self.recipe.half_life)
        counters.seconds = time.monotonic() - self.began
        if counters.step % EVERY == 0:
            numbers = {name: self.distribution.average(float(value)) for name, value in losses.items()}
            ratio = self.distribution.average(diversity(real, fake))
            counters.dull = check(counters.step, numbers, ratio, counters.dull)
            line: dict[str, object] = {k: round(v, 6) for k, v in numbers.items()}
            if self.state.way_distribution is not None:
                line["ways"] = [round(share, 4) for share in self.state.way_distribution.shares.tolist()]
            self.recorder.write(counters.step, counters.seconds, **line)
            self.recorder.show(progress, f"step {counters.step}")
        if counters.step % self.recipe.checkpoint_every == 0:
            self.save()

    def _step(self, progress: float) -> tuple[dict[str, Tensor], Tensor, Tensor]:
        """`discriminator_steps` updates of the discriminators and one of the generator."""
        recipe, state = self.recipe, self.state
        losses: dict[str, Tensor] = {}
        for i in range(recipe.discriminator_steps):
            draw = state.counters.step * recipe.discriminator_steps + i
            last = i == recipe.discriminator_steps - 1
            with torch.set_grad_enabled(last):
                x = self._generate(draw)
            seen = x.repeat_interleave(recipe.looks_each, 0) if recipe.looks_each > 1 else x
            batches = [self._batch(panel, seen, draw, index, last) for index, panel in enumerate(state.panels)]
            losses |= self._update_discriminators(batches, draw)
        losses["loss_g"] = self._update_generator(x, batches, progress)
        return losses, batches[0].real, batches[0].fake.detach()

    def _generate(self, draw: int) -> Tensor:
        rng = generator_at(self.recipe.seed, draw, f"codes/{self.distribution.rank}")
        things = self.recipe.batch // self.recipe.looks_each
        code = self.state.generator.draw(things, rng).to(self.state.device)
        with self._autocast():
            return self.forward(code).float()

    def _batch(self, panel: Panel, x: Tensor, draw: int, index: int, differentiable: bool) -> Batch:
        recipe, ranks = self.recipe, self.distribution
        rows = panel.rows(recipe.batch, derived_seed(recipe.seed, index, "rows"), draw, ranks.rank, ranks.world)
        with torch.set_grad_enabled(differentiable):
            rng = panel_rng(recipe.seed, draw, index, ranks.rank)
            if isinstance(recipe.assignment, LearnedPrior):
                fake = panel.look_as_learned(x, recipe.assignment, rng)
            else:
                fake = panel.look(x, panel.ways[rows], rng)
        real = panel.items[rows].to(fake)
        if recipe.augmentation is not None:
            rng = generator_at(recipe.seed, draw, f"augmentation/{index}/{ranks.rank}")
            real, fake = recipe.augmentation(real, rng), recipe.augmentation(fake, rng)
        return Batch(panel, real, fake, panel.heads[rows].to(fake.device))

    def _update_discriminators(self, batches: list[Batch], draw: int) -> dict[str, Tensor]:
        recipe, state = self.recipe, self.state
        state.discriminators.requires_grad_(True)
        penalise = recipe.penalty is not None and draw % recipe.penalty.every == recipe.penalty.every - 1
        total, smooth = torch.zeros((), device=state.device), torch.zeros((), device=state.device)
        for index, batch in enumerate(batches):
            with self._autocast():
                # One concatenated forward: batch statistics see both kinds of image, spectral vectors move once.
                logits = batch.panel.discriminator(torch.cat([batch.real, batch.fake.detach()]), batch.head.repeat(2))
            real, fake = logits.float().chunk(2)
            total = total + recipe.loss.discriminator(real, fake)
            batch.real_logits = real.detach()
            if penalise and recipe.penalty is not None:
                rng = generator_at(recipe.seed, draw, f"penalty/{index}/{self.distribution.rank}")
                found = recipe.penalty(batch.judge, batch.real, batch.fake.detach(), rng)
                smooth = smooth + batch.panel.smoothing * found
        self._apply(state.discriminators, state.discriminator_optimiser, total + smooth)
        return {"loss_d": total.detach()} | ({"penalty": smooth.detach()} if penalise else {})

    def _update_generator(self, x: Tensor, batches: list[Batch], progress: float) -> Tensor:
        # The discriminators' own gradients are not wanted here; skipping them saves a third of the pass.
        self.state.discriminators.requires_grad_(False)
        losses = []
        for batch in batches:
            with self._autocast():
                fake = batch.judge(batch.fake)
            losses.append(self.recipe.loss.generator(batch.real_logits, fake.float()))
        if self.recipe.balance and len(batches) > 1 and self.state.counters.step % self.recipe.balance == 0:
            self._measure_pulls(batches, losses)
        total = torch.zeros((), device=self.state.device)
        balanced = total
        for batch, loss in zip(batches, losses, strict=True):
            total = total + batch.panel.weight * loss.detach()
            balanced = balanced + batch.panel.weight / batch.panel.pull * loss
        extra = self.recipe.regulariser(x, progress) if self.recipe.regulariser else 0.0
        ways, optimiser = self.state.way_distribution, self.state.way_optimiser
        if isinstance(self.recipe.assignment, LearnedPrior) and ways is not None and optimiser is not None:
            optimiser.zero_grad()
            extra = extra + self.recipe.assignment.evenness * ways.unevenness()
        self._apply(self.state.generator, self.state.generator_optimiser, balanced + extra)
        if ways is not None and optimiser is not None:
            self.distribution.average_gradients(ways)
            optimiser.step()
        return total

    def _measure_pulls(self, batches: list[Batch], losses: list[Tensor]) -> None:
        """Move each panel's `pull` halfway towards the norm of its loss's gradient by the generator's parameters."""
        parameters = [p for p in self.state.generator.parameters() if p.requires_grad]
        for batch, loss in zip(batches, losses, strict=True):
            slopes = torch.autograd.grad(loss, parameters, retain_graph=True, allow_unused=True)
            norm = torch.stack([slope.float().square().sum() for slope in slopes if slope is not None]).sum().sqrt()
            found = max(self.distribution.average(norm.item()), 1e-12)
            first = self.state.counters.step == 0
            batch.panel.pull = found if first else (batch.panel.pull * found) ** 0.5

    def _apply(self, module: torch.nn.Module, optimiser: torch.optim.Optimizer, loss: Tensor) -> None:
        optimiser.zero_grad()
        loss.backward()
        self.distribution.average_gradients(module)
        optimiser.step()

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.state.device.type, torch.bfloat16, enabled=self.recipe.precision == "bfloat16")

    def _set_rates(self, progress: float) -> None:
        state, recipe = self.state, self.recipe
        for optimiser, settings in (
            (state.generator_optimiser, recipe.generator_optimiser),
            (state.discriminator_optimiser, recipe.discriminator_optimiser),
        ):
            optimiser.param_groups[0]["lr"] = settings.rate_at(progress) * state.counters.rate_scale

    def guess(self, settings: Predicted, first: FirstGuess) -> None:
        """Round 0, where something is known of the real images before anything is generated."""
        panel, seed = self.state.panels[0], derived_seed(self.recipe.seed, 0, "assignment")
        self._take(settings, panel, first(panel.observations, panel.items, seed), seed, event="guessed")

    def _take(self, settings: Predicted, panel: Panel, odds: Tensor, seed: int, **fields: object) -> None:
        """Choose a way of looking and a head for each real image by its odds (N, ways), and note it."""
        rng = generator_at(seed, 0, "choose")
        panel.ways = choose_ways(odds, settings.draw, rng)
        panel.heads = k_means(odds, settings.clusters, rng) if settings.clusters else panel.ways.clone()
        self.distribution.copy_from_leader([panel.ways, panel.heads])
        counters = self.state.counters
        counters.seconds = time.monotonic() - self.began
        counts = torch.bincount(panel.ways, minlength=len(panel.observations)).tolist()
        self.recorder.write(counters.step, counters.seconds, **fields, ways=counts)

    def assign(self, settings: Predicted, due: int) -> bool:
        """A round of assignment: train the view predictor on what the generator makes, assign the real images.

        False if it was asked to stop before the end; called again, it goes on.
        """
        state, recipe = self.state, self.recipe
        panel, counters = state.panels[0], state.counters
        if not counters.fitting:
            state.begin_fit(recipe, due)
        assert state.predictor is not None and state.predictor_optimiser is not None
        self.distribution.copy_from_leader([*state.average.parameters(), *state.average.buffers()])

        seed = derived_seed(recipe.seed, due, "assignment")
        report = self.recorder.subtask("view predictor", settings.steps)
        fitting = fit(
            state.predictor,
            state.predictor_optimiser,
            *self._labelled(settings.images, seed),
            settings,
            seed,
            counters.fitted,
        )
        loss = torch.tensor(float("nan"))
        for done, loss in fitting:
            counters.fitted = done
            if done < settings.steps and done % FIT_REPORTS == 0:
                report(done, loss.item())
                if done % FIT_SAVES == 0:
                    self.save()
                if self.stopping():
                    return False
        report(settings.steps, loss.item())
        probabilities = estimated(predict(state.predictor, panel.items, settings.binarise), settings)
        self._take(settings, panel, probabilities, seed, event="assigned", round=due, loss=round(loss.item(), 6))
        if settings.restart and counters.round == 0:
            state.restart(recipe)
            self.forward = self._compiled()
        state.end_fit()
        return True

    @torch.no_grad()
    def _labelled(self, images: int, seed: int) -> tuple[Tensor, Tensor]:
        """Projections of generated things at uniform ways of looking, and those ways; each thing is seen often."""
        panel, average = self.state.panels[0], self.state.average
        seen, ways = [], []
        for start in range(0, images, PREDICTOR_CHUNK):
            rng = generator_at(seed, start, "labelled projections")
            things = average(average.draw(PREDICTOR_CHUNK // LOOKS, rng).to(self.state.device))
            ways.append(torch.randint(len(panel.observations), (PREDICTOR_CHUNK,), generator=rng))
            seen.append(panel.look(things.repeat_interleave(LOOKS, 0), ways[-1], rng))
        return torch.cat(seen)[:images], torch.cat(ways)[:images]

    def save(self) -> None:
        """A checkpoint and a picture, unless this step has them. Raises Diverged if anything is not finite."""
        counters = self.state.counters
        if self.saved == self._instant():
            return
        counters.seconds = time.monotonic() - self.began
        counters.lines = self.recorder.lines
        tensors = self.state.tensors()
        check_finite(counters.step, tensors, self.distribution.agree)
        if self.distribution.leads:
            checkpoint.save(self.out / "checkpoints", counters.step, tensors)
            save_samples(self.state.average, self.out / "samples" / f"step-{counters.step:09d}.png")
        self.distribution.barrier()
        self.saved = self._instant()

    def go_back(self, trouble: Diverged) -> None:
        """Return once to the last good checkpoint, with half the learning rate; the second time, give up."""
        checkpoints = checkpoint.list_checkpoints(self.out / "checkpoints")
        counters = self.state.counters
        if counters.rescues or not checkpoints:
            raise trouble
        at, seconds = counters.step, counters.seconds
        self.state.load(checkpoint.load(checkpoints[-1]))
        counters.rescues, counters.rate_scale, counters.dull = 1, counters.rate_scale / 2, 0
        self.began = time.monotonic() - seconds
        self.recorder.say(f"{trouble}; going back to step {counters.step} with half the learning rate")
        self.recorder.write(counters.step, seconds, event="rescued", at=at, reason=str(trouble))


class Batch:
    """What one panel sees at one update: pairs of real and generated images, each pair with its head."""

    def __init__(self, panel: Panel, real: Tensor, fake: Tensor, head: Tensor) -> None:
        self.panel, self.real, self.fake, self.head = panel, real, fake, head
        self.real_logits = torch.empty(0)

    def judge(self, images: Tensor) -> Tensor:
        """Logits of one image a pair."""
        return self.panel.discriminator(images, self.head)


@contextmanager
def stop_request() -> Iterator[Callable[[], bool]]:
    """The first Ctrl-C (or SIGTERM) asks the loop to save and leave; the second one interrupts at once."""
    asked = False

    def ask(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    try:
        previous = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not in the main thread: signals are someone else's business
        previous = {}
    try:
        yield lambda: asked
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


__all__ = ["Loop", "resume", "train"]
