"""Resumable sampling: the rows of a step's batch are a function of (seed, step).

Row numbers are drawn from one endless sequence, a fresh permutation of the collection every epoch,

    π_0(0) ... π_0(n-1)  π_1(0) ... π_1(n-1)  π_2(0) ...,      π_e derived from (seed, e),

and step s of `world` processes takes the places from s · batch · world on, `batch` of them a process. So
nothing is stored: a resumed run asks for step s and gets what a run that was never killed gets.
"""

from __future__ import annotations

from functools import lru_cache

import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError


def batch_rows(
    count: int, batch: int, seed: int, step: int, rank: int = 0, world: int = 1, *, stream: str = "rows"
) -> Tensor:
    """(batch,) int64 rows of a collection of `count` for one step; `stream` tells apart collections of one run.

    Every row comes once an epoch. A batch may span epochs, so a collection smaller than a batch repeats.

    Raises:
        UserError: if the collection is empty or the batch below 1.
    """
    if count < 1 or batch < 1:
        raise UserError(f"cannot draw a batch of {batch} from {count} items; give at least one of each")
    start = (step * world + rank) * batch
    places = range(start, start + batch)
    epochs = range(places[0] // count, places[-1] // count + 1)
    sequence = torch.cat([permutation(count, seed, epoch, stream) for epoch in epochs])
    return sequence[torch.arange(batch) + start - epochs[0] * count]


@lru_cache(maxsize=16)
def permutation(count: int, seed: int, epoch: int, stream: str = "rows") -> Tensor:
    """π_epoch, (count,) int64. Cached, because consecutive steps share it: do not write into it."""
    return torch.randperm(count, generator=generator_at(seed, epoch, stream))


def spread_rows(count: int, most: int) -> Tensor:
    """Return the indices of min(count, most) of `count` items, evenly spread.

    Examples:
        >>> spread_rows(7, 3), spread_rows(2, 3)
        (tensor([0, 3, 6]), tensor([0, 1]))
    """
    return torch.linspace(0, count - 1, min(count, most)).long()
