"""Items of a collection: what they may be, and how many of what stands beside them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from .._types import UserError
from .lazy import Lazy
from .readers.found import chunks


def tensor_of(items: Any, source: str) -> Tensor | Lazy:
    if isinstance(items, Lazy):
        return items
    if isinstance(items, (str, os.PathLike)):
        raise UserError(
            f"{os.fspath(items)}: a Collection is made of items; read a path with Collection.silhouettes, .images, "
            ".lines, .volumes, .materials or .photographs"
        )
    items = torch.as_tensor(items)
    if not (items.dtype in (torch.uint8, torch.bool) or items.is_floating_point()):
        raise UserError(f"{source}: is of type {str(items.dtype).removeprefix('torch.')}; give bool, uint8 or floats")
    return items if items.dtype == torch.uint8 else items.byte() if items.dtype == torch.bool else items.float()


def checked(items: Tensor | Lazy, source: str) -> Tensor | Lazy:
    if not items.shape or 0 in items.shape:
        raise UserError(f"{source}: holds no items; give at least one")
    if (
        isinstance(items, Tensor)
        and items.is_floating_point()
        and not all(bool(torch.isfinite(part).all()) for part in chunks(items))
    ):
        raise UserError(f"{source}: has values that are NaN or infinite; replace them")
    return items


def check_lengths(source: str, count: int, columns: Mapping[str, Any]) -> None:
    for name, column in columns.items():
        if len(column) != count:
            raise UserError(f"{source}: {count} items but {len(column)} values of {name}; give one for each item")
