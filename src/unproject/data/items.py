"""Items of a collection: what they may be, and how many of what stands beside them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
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
    items = torch.as_tensor(native(items))
    if not (items.dtype in (torch.uint8, torch.bool) or items.is_floating_point()):
        raise UserError(f"{source}: is of type {str(items.dtype).removeprefix('torch.')}; give bool, uint8 or floats")
    return items if items.dtype == torch.uint8 else items.byte() if items.dtype == torch.bool else items.float()


def native(values: Any) -> Any:
    """Return an array as torch takes it: a copy if its bytes are in the other order, as those of FITS are, or flipped.

    Examples:
        >>> import numpy as np
        >>> torch.as_tensor(native(np.arange(3, dtype=">f4")[::-1]))
        tensor([2., 1., 0.])
    """
    if not isinstance(values, np.ndarray) or values.dtype.kind not in "biuf":
        return values
    values = values.astype(values.dtype.newbyteorder("="), copy=False)
    return values.copy() if min(values.strides, default=0) < 0 else values


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


def check_columns(source: str, count: int, columns: Mapping[str, Any]) -> None:
    for name, column in columns.items():
        if len(column) != count:
            raise UserError(f"{source}: {count} items but {len(column)} values of {name}; give one for each item")
        if isinstance(column, Tensor) and not bool(column.isfinite().all()):
            raise UserError(f"{source}: {name} has values that are NaN or infinite; leave out these items, or latents")
