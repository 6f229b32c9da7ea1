"""Estimate: memory and seconds that a training step takes, found on a few samples before training starts.

`Peak` counts the bytes of all tensors that are alive at once, on the processor by a dispatch mode. Let S_k be the peak
of a training step of k samples; D that of drawing four and P that of projecting them, both without a backward pass.
With W bytes of weights and n samples a step, v projections of each,

    memory = 64 MiB + 4 W + S_2 + (S_4 - S_2) (n - 2) / 2 + max(64 D / 4, c P / 4 v)

64 MiB are modules that training imports; 4 W are weights, Adam's two moments, averages and checkpoints; samples are
drawn 64 at a time, and c images are projected at once to fit a view predictor. The system's allocator keeps what a step
has freed, so that drawing adds to it. Measured: see `tests/training/test_estimate.py`. Seconds grow with n / 4: too
many where four samples leave cores idle.
"""

from __future__ import annotations

import time
import weakref
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from .._random import generator_at, seeded
from ..assignment import LearnedLatents, Panel
from . import memory
from .recipe import Recipe

FEW, MORE = 2, 4
DRAWN_AT_ONCE = 64
MODULES = 64 * 2**20


@dataclass(frozen=True)
class Estimate:
    """What a training step takes.

    Attributes:
        memory: bytes beside the data, at most.
        seconds: of one step.
    """

    memory: int
    seconds: float

    def __str__(self) -> str:
        return f"about {self.memory / memory.GIB:.1f} GB, about {self.seconds:.0f} s a step"


def estimate(recipe: Recipe, device: torch.device) -> Estimate:
    """Estimate what a step takes, by steps of two and of four samples.

    A trial that takes half of the available memory is left; the estimate is a bound then.
    """
    there = memory.available_memory(device)
    trial = Trial(recipe, device, None if there is None else there // 2)
    samples = recipe.samples
    few, seconds = trial.measured(trial.step, FEW)
    fixed = MODULES + 4 * trial.weights
    if trial.full:
        return Estimate(fixed + few * samples // FEW, seconds * recipe.discriminator_steps * samples / FEW)
    more, seconds = trial.measured(trial.step, MORE)
    step = few + max(more - few, 0) * (samples - FEW) // (MORE - FEW)
    if seconds * samples > 10:  # counting takes time
        began = time.monotonic()
        trial.step()
        seconds = time.monotonic() - began
    drawn = trial.measured(trial.draw, MORE)[0] * DRAWN_AT_ONCE // MORE
    at_once = max(panel.assignment.projected_at_once for panel in recipe.panels)
    images = MORE * recipe.views_per_sample
    projected = trial.measured(trial.project, MORE)[0] * at_once // images if at_once else 0
    seconds *= recipe.discriminator_steps * samples / MORE
    return Estimate(fixed + step + max(drawn, projected), seconds)


class Trial:
    """A step of a few samples, on networks of its own.

    Attributes:
        weights: bytes of the weights of all networks.
        full: whether a measurement was left at `limit` bytes.
    """

    def __init__(self, recipe: Recipe, device: torch.device, limit: int | None) -> None:
        self.recipe, self.device, self.limit, self.full = recipe, device, limit, False
        self.samples = FEW
        with seeded(recipe.seed, "estimate"):
            self.generator = recipe.generator().to(device)
            self.discriminators = [
                recipe.discriminator(panel.shape, panel.assignment.heads(panel)).to(device) for panel in recipe.panels
            ]
        networks = (self.generator, *self.discriminators)
        self.weights = sum(p.numel() * p.element_size() for network in networks for p in network.parameters())

    def measured(self, part: Callable[[], None], samples: int) -> tuple[int, float]:
        """Return the peak, in bytes, and the seconds of a part on so many samples."""
        self.samples = samples
        peak, began = Peak(self.limit), time.monotonic()
        cuda = self.device.type == "cuda"
        if cuda:
            torch.cuda.reset_peak_memory_stats(self.device)
            before = torch.cuda.memory_allocated(self.device)
        try:
            with seeded(self.recipe.seed, "estimate"), nullcontext() if cuda else peak:
                part()
        except _Full:
            self.full = True
        if cuda:
            torch.cuda.synchronize(self.device)
        most = torch.cuda.max_memory_allocated(self.device) - before if cuda else peak.most
        return most, time.monotonic() - began

    def draw(self) -> None:
        self.generator.sample(self.samples, batch=self.samples)

    @torch.no_grad()
    def project(self) -> None:
        x = self._generated()
        for panel in self.recipe.panels:
            self._projected(panel, x)

    def step(self) -> None:
        x = self._generated()
        pairs = zip(self.recipe.panels, self.discriminators, strict=True)
        torch.stack([self._loss(panel, discriminator, x) for panel, discriminator in pairs]).sum().backward()
        for network in (self.generator, *self.discriminators):
            network.zero_grad()

    def _generated(self) -> Tensor:
        """Return samples, each as often as it is projected."""
        code = self.generator.draw(self.samples, generator_at(0, 0, "estimate")).to(self.device)
        with self._autocast():
            x = self.generator(code).float()
        return x.repeat_interleave(self.recipe.views_per_sample, 0)

    def _projected(self, panel: Panel, x: Tensor) -> Tensor:
        rng = generator_at(0, 0, "estimate")
        views = torch.randint(len(panel.observations), (len(x),), generator=rng)
        learned = LearnedLatents(panel.learned).to(x.device) if panel.learned else None
        if learned is not None:
            learned.advance(1.0)  # later steps take most
        return panel.project(x, views, rng, learned)

    def _loss(self, panel: Panel, discriminator: nn.Module, x: Tensor) -> Tensor:
        """Return the discriminator's loss of real and generated images, with its penalty."""
        recipe, rng = self.recipe, generator_at(0, 0, "estimate")
        fake = self._projected(panel, x)
        real = panel.batch(torch.randint(len(panel), (len(x),), generator=rng)).to(fake)
        heads = torch.zeros(len(x), dtype=torch.long, device=fake.device)
        with self._autocast():
            logits = discriminator(torch.cat([real, fake]), heads.repeat(2)).float()
        found = recipe.loss.discriminator(*logits.chunk(2))
        if recipe.penalty is not None:
            found = found + recipe.penalty(lambda images: discriminator(images, heads), real, fake.detach(), rng)
        return found

    def _autocast(self) -> torch.autocast:
        return torch.autocast(self.device.type, torch.bfloat16, enabled=self.recipe.precision == "bfloat16")


class _Full(Exception):
    """More is alive than the limit."""


class Peak(TorchDispatchMode):
    """Counts the bytes of tensors made within it that are alive at once; `most` is their peak.

    Args:
        limit: bytes; more of them raise.
    """

    def __init__(self, limit: int | None = None) -> None:
        super().__init__()
        self.limit, self.most, self.alive = limit, 0, 0
        self._sizes: dict[int, int] = {}
        self._references: dict[int, Any] = {}

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        made = func(*args, **(kwargs or {}))
        for tensor in tree_leaves(made):
            if isinstance(tensor, Tensor):
                self._count(tensor.untyped_storage())
        if self.limit is not None and self.alive > self.limit:
            raise _Full
        return made

    def _count(self, storage: torch.UntypedStorage) -> None:
        key = storage._cdata
        if key in self._sizes:
            return
        self._sizes[key] = storage.nbytes()
        self._references[key] = weakref.ref(storage, lambda _: self._drop(key))
        self.alive += self._sizes[key]
        self.most = max(self.most, self.alive)

    def _drop(self, key: int) -> None:
        self.alive -= self._sizes.pop(key, 0)
        self._references.pop(key, None)
