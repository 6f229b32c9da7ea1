"""Records: items with their names and, where known, the latents they were made with.

What every reader returns; `Collection` is the same thing with a constructor that finds the reader.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor
from typing_extensions import Self

from .._types import UserError


@dataclass(frozen=True, eq=False)
class Records:
    """N items.

    Attributes:
        items: (N, 1, H, W) pictures or (N, X, Y, Z) volumes, float32 in [0, 1].
        names: one name an item.
        latents: the known views, name → (N,) float32 (angles in radians); None if unknown.
        skipped: (name, reason) of each file that was found and not used.
        source: where the items come from, for messages and for the run's record.
    """

    items: Tensor
    names: tuple[str, ...] = ()
    latents: dict[str, Tensor] | None = None
    skipped: tuple[tuple[str, str], ...] = ()
    source: str = "memory"

    @classmethod
    def from_tensor(
        cls,
        items: Any,
        latents: Mapping[str, Any] | None = None,
        names: Sequence[str] | None = None,
        skipped: Sequence[tuple[str, str]] = (),
        source: str = "memory",
    ) -> Self:
        """Records of a tensor or array already in memory.

        Raises:
            UserError: if there is no item, an item is not finite, or names or latents are of another length.
        """
        items = torch.as_tensor(items).float()
        if items.ndim < 1 or items.numel() == 0:
            raise UserError(f"{source}: holds no items; give at least one")
        if not bool(torch.isfinite(items).all()):
            raise UserError(f"{source}: has values that are NaN or infinite; replace them")
        names = [f"{i:05d}" for i in range(len(items))] if names is None else names
        known = None if latents is None else {k: torch.as_tensor(v).float() for k, v in latents.items()}
        _check_lengths(source, len(items), {"names": names, **(known or {})})
        return cls._made(items, tuple(names), known, tuple(skipped), source)

    @classmethod
    def _made(cls, *fields: Any) -> Self:
        made = cls.__new__(cls)
        Records.__init__(made, *fields)
        return made

    def __len__(self) -> int:
        return len(self.items)

    def batch(self, rows: Tensor) -> Tensor:
        """Return the items of these rows, (B, ...) float32."""
        return self.items[rows].float()

    def floats(self) -> Tensor:
        """Return all items, (N, ...) float32."""
        return self.items.float()

    def subset(self, rows: Tensor | Sequence[int] | slice) -> Self:
        """The records of these rows, in this order."""
        index = torch.arange(len(self))[rows]
        known = None if self.latents is None else {name: v[index] for name, v in self.latents.items()}
        names = tuple(self.names[i] for i in index.tolist())
        return self._made(self.items[index], names, known, self.skipped, self.source)

    def __repr__(self) -> str:
        views = "unknown views" if self.latents is None else f"known {', '.join(self.latents)}"
        shape = " x ".join(map(str, self.items.shape[1:]))
        return f"{type(self).__name__}({len(self)} items of {shape} from {self.source}, {views})"


def _check_lengths(source: str, count: int, columns: Mapping[str, Any]) -> None:
    for name, column in columns.items():
        if len(column) != count:
            raise UserError(f"{source}: {count} items but {len(column)} values of {name}; give one an item")
