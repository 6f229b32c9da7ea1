"""Health: notices that a run has gone wrong before it wastes the rest of its budget."""

from __future__ import annotations

import math

from torch import Tensor

from .._types import UserError

EVERY = 20
"""Steps between looks: reading a number back stalls a GPU."""
WARM_UP = 300
DULL = 0.02
PATIENCE = 5


class Diverged(UserError):
    """Training cannot go on: a loss is not finite, or everything generated looks the same."""


def check(step: int, losses: dict[str, float], real: Tensor, fake: Tensor, dull: int) -> int:
    """Raise Diverged, or return how many looks in a row found the generated images all alike.

    Diversity is the standard deviation over the batch, averaged over pixels; a batch is dull when it has less
    than 2 % of the real one's. Five dull looks in a row, after the first 300 steps, are a collapse.
    """
    for name, value in losses.items():
        if not math.isfinite(value):
            raise Diverged(f"training broke down at step {step}: {name} is {value}; lower the learning rate")
    ratio = float(fake.std(0).mean() / real.std(0).mean().clamp_min(1e-9))
    dull = dull + 1 if ratio < DULL and step > WARM_UP else 0
    if dull >= PATIENCE:
        raise Diverged(
            f"training collapsed at step {step}: everything generated looks the same "
            f"(diversity {ratio:.1%} of the real images'); lower the learning rate or raise the penalty"
        )
    return dull
