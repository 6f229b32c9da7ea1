"""Resumable sampling: the rows of a step's batch are a function of (seed, step).

Row numbers are drawn from one endless sequence, a fresh permutation of the collection every epoch,

    π_0(0) ... π_0(n-1)  π_1(0) ... π_1(n-1)  π_2(0) ...,      π_e derived from (seed, e),

and step s takes the places from s · batch on. So nothing is stored: a resumed run asks for step s and gets what a run
that was never killed gets.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError


def batch_rows(count: int, batch: int, seed: int, step: int) -> Tensor:
    """(batch,) int64 rows of a collection of `count` for one step, of all processes.

    Every row comes once an epoch. A batch may span epochs, so a collection smaller than a batch repeats.

    Raises:
        UserError: if the collection is empty or the batch below 1.
    """
    if count < 1 or batch < 1:
        raise UserError(f"cannot draw a batch of {batch} from {count} items; give at least one of each")
    return rows_at(count, range(step * batch, (step + 1) * batch), seed)


def rows_at(count: int, places: range, seed: int) -> Tensor:
    """Return the rows at these places of the endless sequence, int64; a row comes twice if epochs end among them."""
    return torch.cat([*_pieces(count, places, seed)]).long()


def _pieces(count: int, places: range, seed: int) -> Iterator[Tensor]:
    """Yield the places of each epoch among these; the rest, which may be a million rows, is not copied."""
    for epoch in range(places[0] // count, places[-1] // count + 1):
        first = epoch * count
        yield permutation(count, seed, epoch)[max(places[0] - first, 0) : places[-1] + 1 - first]


@lru_cache(maxsize=8)
def permutation(count: int, seed: int, epoch: int) -> Tensor:
    """π_epoch, (count,) int32 (int64 from 2³¹ on). Cached, because consecutive steps share it: do not write into it."""
    kind = torch.int32 if count < 2**31 else torch.int64
    return torch.randperm(count, generator=generator_at(seed, epoch, "rows"), dtype=kind)


def spread_rows(count: int, most: int) -> Tensor:
    """Return the indices of min(count, most) of `count` items, evenly spread.

    Examples:
        >>> spread_rows(7, 3), spread_rows(2, 3)
        (tensor([0, 3, 6]), tensor([0, 1]))
    """
    exact = torch.float32 if count < 2**24 else torch.float64  # both round down alike below, but not everywhere
    return torch.linspace(0, count - 1, min(count, most), dtype=exact).long()
