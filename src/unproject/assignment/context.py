"""Context: what a run offers an assignment before each step."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from ..networks import Generator


class Processes(Protocol):
    """The processes that train together, or one alone."""

    def average_gradients(self, module: nn.Module) -> None:
        """Replace each gradient by its mean over the processes."""
        ...

    def mean(self, values: Tensor) -> Tensor:
        """Return the mean of a tensor over the processes."""
        ...


class Context(Protocol):
    """What a run offers an assignment before each step."""

    @property
    def step(self) -> int:
        """Steps done."""
        ...

    @property
    def progress(self) -> float:
        """The part of the budget that is spent, 0 to 1."""
        ...

    @property
    def generator(self) -> Generator:
        """The generator with averaged weights."""
        ...

    @property
    def device(self) -> torch.device: ...

    def stopping(self) -> bool:
        """Whether the run was asked to stop; then return False from `before_step` soon."""
        ...

    def save(self) -> None:
        """Write a checkpoint now."""
        ...

    def record(self, **fields: Any) -> None:
        """Write a line to the run's log."""
        ...

    def subtask(self, name: str, total: int) -> Callable[[int, float], None]:
        """Show a second progress bar; call the result with (done, loss)."""
        ...

    def synchronise(self, tensors: Iterable[Tensor]) -> None:
        """Overwrite tensors by those of the first process."""
        ...

    def draws(self, until: float, steps: int) -> range:
        """Return the places, in the order of rows, that are drawn from now to the part `until` of the budget.

        Those of so many steps at least. Of a budget in minutes, as many as the steps so far foretell.
        """
        ...

    def rows(self, places: range) -> Tensor:
        """Return the panel's rows at these places (`data.sampling.rows_at`)."""
        ...

    def shared(self, rows: Tensor, predict: Callable[[Tensor], Tensor]) -> Tensor:
        """Return predict(rows), (N, K), of which each process computes its part of the rows."""
        ...

    def restart(self) -> None:
        """Start the generator and the discriminators from new weights."""
        ...
