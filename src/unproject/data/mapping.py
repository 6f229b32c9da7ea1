"""Collections of which every item is changed."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from .collection import Collection
from .lazy import AT_ONCE, Lazy
from .readers.found import to_bytes, to_floats


def mapped(collection: Collection, change: Callable[[Tensor], Tensor]) -> Collection:
    """Return the collection with `change` done to its items: (N, ...) in [0, 1] to the same, stored in 8 bits.

    Items that lie in a file are changed by the batch, so that they stay there.

    Examples:
        >>> import torch, unproject as up
        >>> light = up.Collection(torch.tensor([[[[0.0, 1.0]]]]))
        >>> up.data.mapped(light, lambda images: 1 - images).batch([0])
        tensor([[[[1., 0.]]]])
    """
    stored, white = collection.stored, collection.white
    if isinstance(stored, Lazy):
        items = Lazy(stored, change=lambda some: to_bytes(change(to_floats(some, white))))
    else:
        rows = torch.arange(len(collection)).split(AT_ONCE)
        items = torch.cat([to_bytes(change(collection.batch(some))) for some in rows])
    return Collection(
        items,
        names=collection.names,
        latents=collection.latents,
        skipped=collection.skipped,
        source=collection.source,
        white=255,
    )
