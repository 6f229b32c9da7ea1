"""Mirror images as further data: they cost nothing and are as true as the originals where left and right are alike."""

from __future__ import annotations

import torch
from torch import Tensor

from .._types import UserError
from .collection import Collection
from .records import Records

SIGNS = {"azimuth": -1.0, "elevation": 1.0}


def with_flips(records: Records) -> Collection:
    """Every item followed by its mirror image, so that what was made of one thing still lies together.

    A picture (C, H, W) is flipped left to right, a volume (X, Y, Z) along x. Seen from azimuth θ, the mirror image of
    a thing is the flipped picture of the thing seen from -θ, at any elevation: `latents["azimuth"]` changes its sign.
    The index `latents["look"]` is dropped, since the flipped picture may belong to another way of looking. Right for
    things of which there are as many as of their mirror images.

    Raises:
        UserError: for items that are neither pictures nor volumes, or for latents other than azimuth and elevation.
    """
    if records.items.dim() != 4:
        raise UserError(f"{records.source}: only pictures and volumes can be flipped")
    latents = records.latents
    if latents is not None:
        unknown = sorted(set(latents) - {"look", *SIGNS})
        if unknown:
            raise UserError(f"{records.source}: cannot tell what a flip does to {', '.join(unknown)}; leave flips out")
        latents = {
            name: _paired(latents[name], sign * latents[name]) for name, sign in SIGNS.items() if name in latents
        }
    is_picture = records.items.shape[1] != records.items.shape[3]
    items = _paired(records.items, records.items.flip(3 if is_picture else 1))
    names = [paired for name in records.names for paired in (name, f"{name} flipped")]
    return Collection.from_tensor(items, latents, names, records.skipped, records.source)


def _paired(first: Tensor, second: Tensor) -> Tensor:
    """first[0], second[0], first[1], …"""
    return torch.stack([first, second], 1).flatten(0, 1)
