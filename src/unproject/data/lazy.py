"""Lazy: items that lie in a file and are read, and changed, when they are asked for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import torch
from torch import Tensor

Rows = Tensor | Sequence[int] | slice
Change = Callable[[Tensor], Tensor]

AT_ONCE = 1024


class Lazy:
    """N items y_n = change(x_r(n)) of stored ones x, of which only those that are asked for are in memory.

    Examples:
        >>> import torch
        >>> stored = torch.arange(12, dtype=torch.uint8).view(4, 3)
        >>> odd = Lazy(stored, torch.tensor([1, 3]))
        >>> Lazy(odd, change=lambda items: items.flip(1))[[1]]
        tensor([[11, 10,  9]], dtype=torch.uint8)

    Attributes:
        stored: (M, ...) the items x: a tensor that is mapped into memory, or others that are made when asked for.
        rows: (N,) r; None for all, in their order.
        change: of (B, ...) items, each alone; None for none.
    """

    def __init__(self, stored: Tensor | Lazy, rows: Tensor | None = None, change: Change | None = None) -> None:
        self.stored, self.change = stored, change
        self.rows = None if rows is None else rows.int() if len(stored) < 2**31 else rows
        first = stored[:1] if change is None else change(stored[:1])
        self.shape, self.dtype = torch.Size([len(self), *first.shape[1:]]), first.dtype

    def __len__(self) -> int:
        return len(self.stored) if self.rows is None else len(self.rows)

    def __getitem__(self, rows: Rows) -> Tensor:
        found = self.stored[rows if self.rows is None else self.rows[rows]]
        return found if self.change is None else self.change(found)

    def dim(self) -> int:
        return len(self.shape)

    @property
    def nbytes(self) -> int:
        """Bytes that all items would take."""
        return math.prod(self.shape) * self.dtype.itemsize

    def parts(self) -> Iterator[Tensor]:
        """Yield the items in order, a few at a time."""
        return (self[slice(start, start + AT_ONCE)] for start in range(0, len(self), AT_ONCE))

    def whole(self) -> Tensor:
        """Return all items: what is mapped as it is, what is picked or changed in memory."""
        if self.rows is None and self.change is None:
            return self.stored if isinstance(self.stored, Tensor) else self.stored.whole()
        return torch.cat([*self.parts()])
