"""Found: what a reader found at a path, which `Collection` is made of; and the scale of what is stored."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import torch
from torch import Tensor

from ..._types import UserError
from ..lazy import Lazy

CHUNK = 2**24
"""Values that are checked or converted at once, so that memory-mapped arrays are never whole in memory."""


class Found(NamedTuple):
    """The arguments of `Collection`."""

    items: Tensor | Lazy
    names: Sequence[str] | None = None
    latents: Mapping[str, Tensor] | None = None
    skipped: Sequence[tuple[str, str]] = ()
    source: str = "memory"
    white: int | None = None

    @property
    def whole(self) -> Tensor:
        """All items."""
        return self.items.whole() if isinstance(self.items, Lazy) else self.items

    @property
    def kind(self) -> str:
        """What the items are, by their shape: lines (1, D), pictures (1 or 3, H, W) or volumes (X, Y, Z)."""
        if self.items.dim() == 3:
            return "line integrals"
        return "pictures" if self.items.shape[1] <= 3 else "volumes"


def names_of(found: Found, count: int) -> list[str]:
    """Return the names of the items of an array: its own, or their numbers."""
    return [f"{row:05d}" for row in range(count)] if found.names is None else [*map(str, found.names)]


def without(found: Found, blank: Tensor, reason: str, strict: bool) -> tuple[Found, Tensor | None]:
    """Return it with the items that are marked (N,) counted as skipped, and the rows of the others, None for all.

    Its items are left to the caller, who knows whether they are in memory.

    Raises:
        UserError: if `strict`, for the first that is marked.
    """
    if not bool(blank.any()):
        return found, None
    if strict:
        row = int(blank.nonzero()[0])
        raise UserError(f"{found.source}, item {row}: {reason}; fix or remove it, or leave out --strict")
    names, rows = names_of(found, len(blank)), (~blank).nonzero()[:, 0]
    skipped = [(names[row], reason) for row in blank.nonzero()[:, 0].tolist()]
    latents = None if found.latents is None else {name: value[rows] for name, value in found.latents.items()}
    kept = found._replace(names=[names[row] for row in rows.tolist()], latents=latents)
    return kept._replace(skipped=(*found.skipped, *skipped)), rows


def chunks(items: Tensor | Lazy) -> Iterable[Tensor]:
    """The items in pieces of about `CHUNK` values, along the first axis."""
    if isinstance(items, Lazy):
        return items.parts()
    return items.split(max(1, CHUNK // max(items[:1].numel(), 1)))


def white_of(items: Tensor | Lazy) -> int:
    """The stored value that stands for 1: 1 of floats, 255 of uint8; of labels, whose only value is dark, that one."""
    highest = max(int(part.max()) for part in chunks(items)) if items.dtype == torch.uint8 else 1
    if highest > 127:
        return 255
    labels = all(bool(((part == 0) | (part == highest)).all()) for part in chunks(items)) if highest > 1 else True
    return max(highest, 1) if labels else 255


def to_floats(items: Tensor, white: int) -> Tensor:
    """float32 items / white; those that are float32 as they are."""
    return items if items.dtype == torch.float32 else items.float() if white == 1 else items.float() / white


def to_bytes(items: Tensor) -> Tensor:
    """uint8 of values in [0, 1], 255 standing for 1."""
    return (items * 255).round().byte()


MAX_SIDE = 4096
"""Pixels a side."""


def check_size(path: Path, size: int | None) -> None:
    """Refuse sizes at which nothing can be recognised, and those that fill the memory with one item."""
    if size is not None and not 4 <= size <= MAX_SIDE:
        raise UserError(f"{path}: a size of {size} is out of range; give 4 to {MAX_SIDE}")
