"""Assigned: indices of observations and of heads, one for each image, as a part of the checkpoint."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import torch
from torch import Tensor, nn

from .._types import UserError

T = TypeVar("T", bound="Assigned")


class Assigned(nn.Module):
    """The observation and the discriminator's head of each image, in the smallest signed integers that hold them.

    Of a million images they take two megabytes, not sixteen, in every checkpoint too. `views[rows].long()` are indices.

    Attributes:
        views: (N,) indices of observations.
        heads: (N,) indices of heads.
    """

    views: Tensor
    heads: Tensor

    def __init__(self, views: Tensor, heads: Tensor, observations: int, head_count: int) -> None:
        super().__init__()
        self._counts = {"views": observations, "heads": head_count}
        self.register_buffer("views", views.to(smallest(observations)))
        self.register_buffer("heads", heads.to(smallest(head_count)))

    def load_state_dict(self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False) -> Any:
        """Load what a checkpoint holds.

        Raises:
            UserError: for indices of what is not there.
        """
        for name, count in self._counts.items():  # before they are narrowed to small integers
            stored = state_dict.get(name)
            if stored is not None and not ((stored >= 0) & (stored < count)).all():
                raise UserError(f"the checkpoint's {name} are not all among {count}; it is damaged or of another run")
        return super().load_state_dict(state_dict, strict, assign)

    def _apply(self: T, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> T:
        """Move parameters and modules only: what is assigned stays on the CPU, where rows are drawn."""
        own = dict(self._buffers)
        super()._apply(fn, recurse)
        self._buffers.update(own)
        return self


def smallest(count: int) -> torch.dtype:
    """Return the smallest signed integers that hold 0 to count - 1; unsigned ones are masks where they are indices.

    Examples:
        >>> smallest(16), smallest(300)
        (torch.int8, torch.int16)
    """
    return next(kind for kind in (torch.int8, torch.int16, torch.int32) if count - 1 <= torch.iinfo(kind).max)
