"""Tries: several short starts, of which the one whose assignment knows most goes on.

Adversarial training with unknown views ends in the world that it began to believe in: an object may lie across its
plane of symmetry, or look the same from all sides. Which world pictures fit best shows early, as the information that
they hold of their views (`AssignmentState.merit`). Tries differ by their weights and, if asked, by what they prefer
where pictures alone do not decide: so pictures choose among preferences, none of which is right for everything.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from .._types import UserError
from ..adversarial.regularisers import Regulariser


@dataclass(frozen=True)
class Tries:
    """How often a run starts.

    Args:
        count: tries.
        share: of the budget, for each.
        least_steps: if the first try takes fewer steps, it goes on and no others begin.
        regularisers: of the first try, the second and so on, in turn, besides the recipe's (None: no other). The try
            that goes on keeps its own.

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
    regularisers: tuple[Regulariser | None, ...] = field(default=(), metadata={"described": "if given"})

    def __post_init__(self) -> None:
        if not (self.count >= 1 and self.share > 0 and self.count * self.share < 1 and self.least_steps >= 1):
            raise UserError(f"{self}: give at least one try, and shares of the budget that leave some of it")

    def end(self, number: int) -> float:
        """Return the part of the budget at which a try, counted from 0, ends."""
        return (number + 1) * self.share

    def regulariser(self, number: int) -> Regulariser | None:
        """Return that of a try, counted from 0, besides the recipe's."""
        return self.regularisers[number % len(self.regularisers)] if self.regularisers else None
