"""Assigned: indices of observations and of heads, one for each image, as a part of the checkpoint."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from torch import Tensor, nn

from .._types import UserError

T = TypeVar("T", bound="Assigned")


class Assigned(nn.Module):
    """The observation and the discriminator's head of each image.

    Attributes:
        views: (N,) indices of observations.
        heads: (N,) indices of heads.
    """

    views: Tensor
    heads: Tensor

    def __init__(self, views: Tensor, heads: Tensor, observations: int, head_count: int) -> None:
        super().__init__()
        self._counts = {"views": observations, "heads": head_count}
        self.register_buffer("views", views)
        self.register_buffer("heads", heads)

    def load_state_dict(self, state_dict: Mapping[str, Any], strict: bool = True, assign: bool = False) -> Any:
        """Load what a checkpoint holds.

        Raises:
            UserError: for indices of what is not there.
        """
        loaded = super().load_state_dict(state_dict, strict, assign)
        for name, count in self._counts.items():
            if not ((getattr(self, name) >= 0) & (getattr(self, name) < count)).all():
                raise UserError(f"the checkpoint's {name} are not all among {count}; it is damaged or of another run")
        return loaded

    def _apply(self: T, fn: Callable[[Tensor], Tensor], recurse: bool = True) -> T:
        """Move parameters and modules only: what is assigned stays on the CPU, where rows are drawn."""
        own = dict(self._buffers)
        super()._apply(fn, recurse)
        self._buffers.update(own)
        return self
