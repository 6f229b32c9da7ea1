"""Counters: the numbers of a state that are no weights, in a checkpoint under `counters/`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from .._types import UserError

COUNTERS = "counters/"
"""Prefix of their tensors."""
LATER = ("averaged",)
"""Those that older checkpoints do not have."""


@dataclass
class Counters:
    """The numbers of a state.

    `rollbacks` counts returns to a checkpoint, `collapsed` the checks in a row that found all samples alike, `lines`
    the lines of stats.jsonl; `rate_scale` is a factor of the learning rates of generator and discriminators. `averaged`
    counts the steps that are in averaged weights taken over from another run. `tried` counts the tries that have ended,
    `best_merit` is the merit of the best of them and `best_start` its number; the present state began as the try of
    number `start`, its networks at the step `began`.
    """

    step: int = 0
    rollbacks: int = 0
    collapsed: int = 0
    lines: int = 0
    seconds: float = 0.0
    rate_scale: float = 1.0
    tried: int = 0
    start: int = 0
    began: int = 0
    best_start: int = 0
    best_merit: float = 0.0
    averaged: int = 0

    def tensors(self) -> dict[str, Tensor]:
        """Return them by the names that they have in a checkpoint."""
        return {f"{COUNTERS}{name}": torch.tensor(value, dtype=torch.float64) for name, value in vars(self).items()}

    def load(self, tensors: Mapping[str, Tensor]) -> None:
        """Take over those of a checkpoint.

        Raises:
            UserError: for one that nothing can have counted. KeyError: for one that is not there.
        """
        older = {f"{COUNTERS}{name}": torch.zeros(()) for name in LATER}
        for name, value in vars(self).items():
            setattr(self, name, type(value)(_counter(name, {**older, **tensors}[f"{COUNTERS}{name}"])))


def _counter(name: str, value: Tensor) -> float:
    number = value.item() if value.numel() == 1 else math.nan
    if not (math.isfinite(number) and (name == "best_merit" or 0 <= number < 2**53)):
        raise UserError(f"the checkpoint's {name} is {number:g}; resume from the checkpoint before it")
    return number
