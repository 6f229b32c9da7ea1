"""Coarse: a recipe of half the size that is trained first, and whose weights another one goes on with.

Which views pictures are of, and what objects are like, shows in few pixels, at a fraction of the time. Networks of full
size begin with what those of half the size have learned (`Generator.grow`), and learn what is finer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from .._types import UserError


@dataclass(frozen=True)
class Coarse:
    """What is trained first: the recipe that `make(steps=..., minutes=...)` returns, in OUT/coarse.

    The budget, the steps and the seconds of a run are those of both together; schedules of the fine recipe begin anew.

    Args:
        make: makes the coarse recipe of a budget: steps, minutes or both, the other None.
        share: its part of the budget; 0 for a run that starts from another one's weights.

    Raises:
        UserError: for a share that leaves nothing.

    References:
        Karras et al. 2018, Progressive growing of GANs.

    Examples:
        >>> import functools, unproject as up
        >>> up.Coarse(functools.partial(up.recipes.find("shapes"), size=16), share=0.5).fine(0.75)
        0.5
    """

    make: Callable[..., Any] = field(metadata={"described": False})
    share: float = 0.8

    def __post_init__(self) -> None:
        if not 0 <= self.share < 1:
            raise UserError(f"Coarse(share={self.share:g}): give 0 to below 1")

    def fine(self, spent: float) -> float:
        """Return how far the fine recipe is, 0 to 1, when this part of the budget of both is spent."""
        return max(spent - self.share, 0.0) / (1 - self.share)

    def spent(self, fine: float) -> float:
        """Return the part of the budget of both that is spent when the fine recipe is this far."""
        return self.share + (1 - self.share) * fine

    def budget(self, steps: int | None, minutes: float | None) -> dict[str, Any] | None:
        """Return the steps and minutes of the coarse recipe by those of both; None if it would not take a step."""
        own = None if steps is None else int(self.share * steps)
        if not self.share or own == 0:
            return None
        return {"steps": own, "minutes": None if minutes is None else self.share * minutes}
