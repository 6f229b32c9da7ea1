"""Health: detects divergence and collapse before a run spends the rest of its budget."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from torch import Tensor

from .._types import Diverged

EVERY = 20
"""Steps between checks: reading a number back stalls a GPU."""
WARM_UP = 300
COLLAPSED = 0.02
PATIENCE = 5


def diversity(real: Tensor, fake: Tensor) -> float:
    """Return the standard deviation over the batch, averaged over pixels, of generated over that of real images.

    One image has none; then the two count as alike.
    """
    if len(fake) < 2:
        return 1.0
    return float(fake.std(0).mean() / real.std(0).mean().clamp_min(1e-9))


def check(step: int, losses: dict[str, float], ratio: float, collapsed: int, began: int = 0) -> int:
    """Raise Diverged, or return how many checks in a row found the generated images all alike.

    Samples count as collapsed when the largest diversity of a panel, `ratio`, is less than 2 % of the real images'; a
    single one may have an observation that is rightly alike, as gloss of one material. Five checks in a row, after the
    first 300 steps since training `began`, raise.
    """
    for name, value in losses.items():
        if not math.isfinite(value):
            raise Diverged(f"training broke down at step {step}: {name} is {value}; lower the learning rate")
    collapsed = collapsed + 1 if ratio < COLLAPSED and step - began > WARM_UP else 0
    if collapsed >= PATIENCE:
        raise Diverged(
            f"training collapsed at step {step}: everything generated looks the same "
            f"(diversity {ratio:.1%} of the real images'); lower the learning rate or raise the penalty"
        )
    return collapsed


def not_finite(tensors: Mapping[str, Tensor]) -> str:
    """Return the name of a tensor that is not finite, "" if all are."""
    return next((name for name, v in tensors.items() if v.is_floating_point() and not v.isfinite().all()), "")


def check_finite(step: int, tensors: Mapping[str, Tensor], agree: Callable[[bool], bool]) -> None:
    """Raise Diverged, in all processes that `agree`, if a number of the state, or of what it makes, is not finite.

    Losses are checked now and then only; a checkpoint to roll back to must be good.
    """
    bad = not_finite(tensors)
    if agree(bool(bad)):
        what = bad or "a weight"
        raise Diverged(f"training broke down by step {step}: {what} is not finite; lower the learning rate")
