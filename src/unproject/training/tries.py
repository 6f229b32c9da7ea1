"""Tries: several short starts from different weights, of which the one whose assignment knows most goes on.

Adversarial training with unknown views ends in the world that it began to believe in: an object may lie across its
plane of symmetry, or look the same from all sides. Which world pictures fit best shows early, as the information that
they hold of their views (`AssignmentState.merit`).
"""

from __future__ import annotations

from dataclasses import dataclass

from .._types import UserError


@dataclass(frozen=True)
class Tries:
    """How often a run starts.

    Args:
        count: tries.
        share: of the budget, for each.
        least_steps: if the first try takes fewer steps, it goes on and no others begin.

    Raises:
        UserError: for less than one try, or tries that take all of the budget.

    Examples:
        >>> import unproject as up
        >>> up.Tries(count=3, share=0.05).end(0)
        0.05
    """

    count: int = 3
    share: float = 0.06
    least_steps: int = 100

    def __post_init__(self) -> None:
        if not (self.count >= 1 and self.share > 0 and self.count * self.share < 1 and self.least_steps >= 1):
            raise UserError(f"{self}: give at least one try, and shares of the budget that leave some of it")

    def end(self, number: int) -> float:
        """Return the part of the budget at which a try, counted from 0, ends."""
        return (number + 1) * self.share
