"""Collections of which every item is changed."""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor

from .collection import Collection

AT_ONCE = 1024


def mapped(collection: Collection, change: Callable[[Tensor], Tensor]) -> Collection:
    """Return the collection with `change` done to its items: (N, ...) in [0, 1] to the same, stored in 8 bits.

    Examples:
        >>> import torch, unproject as up
        >>> light = up.Collection(torch.tensor([[[[0.0, 1.0]]]]))
        >>> up.data.mapped(light, lambda images: 1 - images).batch([0])
        tensor([[[[1., 0.]]]])
    """
    rows = torch.arange(len(collection)).split(AT_ONCE)
    items = torch.cat([(change(collection.batch(some)) * 255).round().byte() for some in rows])
    return Collection(
        items,
        names=collection.names,
        latents=collection.latents,
        skipped=collection.skipped,
        source=collection.source,
        white=255,
    )
