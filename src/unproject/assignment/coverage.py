"""Coverage: which images of a large collection have a view that was predicted for them.

The order in which images are drawn is known beforehand (`data.sampling`), so a round predicts those alone that come
before the next one: of a million images, trained on for 4,000 steps of 48 with 40 rounds, 4,800 a round. All others get
the view and the head of a predicted one at random, so that views are as frequent among all images as among those.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import torch
from torch import Tensor, nn

from .context import Context

WHOLE = 2**16
"""Images up to which each round predicts all."""
MIN_PREDICTED = 2**12
"""Images that a round predicts at least, since shares of views are estimated by them."""
MEASURED = 2**13
"""Images of a large collection, evenly spread over it, that scores of views are measured on."""
T = TypeVar("T", bound="Coverage")


class Coverage(nn.Module):
    """The places, in the order in which images are drawn, whose images were predicted.

    Attributes:
        places: (2,) the first of them and the one behind the last; -1 as long as there is no predictor.
    """

    places: Tensor

    def __init__(self) -> None:
        super().__init__()
        self.register_buffer("places", torch.full((2,), -1))

    def extend(self, run: Context, until: float, steps: int) -> Tensor:
        """Cover what is drawn before the part `until` of the budget, and in so many steps at least; return the rows."""
        now = run.draws(until, steps)
        end = max(now.stop, now.start + MIN_PREDICTED)
        self.places.copy_(torch.tensor([now.start, end]))
        return run.rows(range(now.start, end)).unique()

    def expire(self) -> None:
        """Let nothing be covered, though there is a predictor."""
        self.places.zero_()

    def is_left(self, run: Context) -> bool:
        """Whether there is a predictor and this step draws images that it has not predicted.

        Rounds come later than was foreseen if a budget in minutes makes more steps, or a run is resumed with another
        budget or in another number of processes.
        """
        now, (first, end) = run.draws(0.0, 1), self.places.tolist()
        return first >= 0 and not first <= now.start <= now.stop <= end

    def _apply(self: T, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> T:
        """Stay on the CPU, where rows are drawn."""
        return self


def spread_over(values: Tensor, rows: Tensor, count: int, rng: torch.Generator) -> Tensor:
    """Return (count,) values: those of `rows` there, and elsewhere that of one of them at random."""
    whole = values[torch.randint(len(rows), (count,), generator=rng)]
    whole[rows] = values
    return whole
