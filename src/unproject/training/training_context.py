"""TrainingContext: what the trainer offers an assignment before a step, `assignment.Context`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import torch
from torch import Tensor

from .._random import derived_seed
from ..data.sampling import rows_at
from ..networks import Generator


class TrainingContext:
    """What the trainer offers an assignment before a step, for one panel.

    The trainer makes it, so that its class is not imported here.
    """

    def __init__(self, trainer: Any, progress: float, panel: int) -> None:
        self._trainer, self.progress, self._panel = trainer, progress, panel
        self.restart = trainer.restart
        self.subtask = trainer.recorder.subtask

    @property
    def step(self) -> int:
        return self._trainer.state.counters.step

    @property
    def generator(self) -> Generator:
        return self._trainer.state.average

    @property
    def device(self) -> torch.device:
        return self._trainer.state.device

    def stopping(self) -> bool:
        """Whether the run was asked to stop, or its budget was spent meanwhile."""
        return self._trainer.stopping() or self._trainer.progress() >= 1

    def save(self) -> None:
        self._trainer.saved = None
        self._trainer.save()

    def record(self, **fields: Any) -> None:
        panel = {"panel": self._panel} if self._panel else {}
        self._trainer.record(**fields, **panel)

    def synchronise(self, tensors: Iterable[Tensor]) -> None:
        self._trainer.distribution.copy_from_leader(tensors)

    def draws(self, until: float, steps: int) -> range:
        recipe, counters, distribution = self._trainer.recipe, self._trainer.state.counters, self._trainer.distribution
        seconds = distribution.average(counters.seconds)  # clocks differ, and all processes must draw the same
        steps = max(steps, recipe.steps_until(until, counters.step, seconds))
        each = recipe.batch * recipe.discriminator_steps * distribution.world
        return range(counters.step * each, (counters.step + steps) * each)

    def rows(self, places: range) -> Tensor:
        recipe = self._trainer.recipe
        return rows_at(len(recipe.panels[self._panel]), places, derived_seed(recipe.seed, self._panel, "rows"))

    def shared(self, rows: Tensor, predict: Callable[[Tensor], Tensor]) -> Tensor:
        distribution = self._trainer.distribution
        parts = rows.tensor_split(distribution.world)
        return distribution.joined(predict(parts[distribution.rank]), [len(part) for part in parts])
