"""Mirror images as further data, right for objects of which there are as many as of their mirror images."""

from __future__ import annotations

import torch
from torch import Tensor

from .._types import UserError
from .collection import Collection
from .splitting import FLIPPED

SIGNS = {"azimuth": -1.0, "elevation": 1.0}


def with_flips(collection: Collection) -> Collection:
    """Return every item followed by its mirror image, so that projections of one object still lie together.

    A picture (C, H, W) is flipped left to right, a volume (X, Y, Z) along x. Seen from azimuth θ, the mirror image of
    an object is the flipped picture of the object seen from -θ, at any elevation: `latents["azimuth"]` changes its
    sign. The index `latents["view"]` is dropped, since the flipped picture may belong to another observation.

    Raises:
        UserError: for items that are neither pictures nor volumes, or for latents other than azimuth and elevation.
    """
    items = collection.items
    if items.dim() != 4:
        raise UserError(f"{collection.source}: only pictures and volumes can be flipped; give either")
    is_picture = items.shape[1] != items.shape[3]
    return Collection(
        _paired(items, items.flip(3 if is_picture else 1)),
        names=[paired for name in collection.names for paired in (name, name + FLIPPED)],
        latents=_flipped_views(collection),
        skipped=collection.skipped,
        source=collection.source,
        white=collection.white,
    )


def _flipped_views(collection: Collection) -> dict[str, Tensor] | None:
    latents = collection.latents
    if latents is None:
        return None
    unknown = sorted(set(latents) - {"view", *SIGNS})
    if unknown:
        raise UserError(f"{collection.source}: cannot tell how {', '.join(unknown)} changes in a flip; leave flips out")
    return {name: _paired(latents[name], sign * latents[name]) for name, sign in SIGNS.items() if name in latents}


def _paired(first: Tensor, second: Tensor) -> Tensor:
    """first[0], second[0], first[1], …"""
    return torch.stack([first, second], 1).flatten(0, 1)
