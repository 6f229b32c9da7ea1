"""Known views: which observation made each image of a collection whose latents are known."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from .._types import UserError
from ..data import Collection
from ..projections.observation import Observation

FIXES = {
    "elevation": ", or give --bands enough bands of elevation",
    "angle": ", or widen --spread: 90 / bins degrees leave no gap",
}
"""What else helps if a known view lies outside every bin, by the latent."""


def views_of(collection: Collection, observations: Sequence[Observation]) -> Tensor:
    """Return (N,) the first observation whose prior contains each item's known latents; missing latents count as 0.

    Raises:
        UserError: if no latents are known, or those of an item lie in no prior.
    """
    names = observations[0].prior.names
    inside = _inside(collection, observations)
    if inside is None:
        first = names[0] if names else "view"
        raise UserError(
            f"{collection.source}: known views are asked for but none are there; add a views.csv (file,{first} in "
            f"degrees) to a folder or an array `{first}` (radians) to an .npz, or use --views predicted"
        )
    outside = ~inside.any(1)
    if bool(outside.any()):
        more = "".join(fix for name, fix in FIXES.items() if name in names)
        raise UserError(
            f"{collection.source}: the known view of {int(outside.sum())} of {len(inside)} images lies outside every "
            f"bin; leave them out{more}"
        )
    return inside.byte().argmax(1)


def views_if_known(collection: Collection, observations: Sequence[Observation]) -> Tensor | None:
    """Return the same, or None if no latents are known or those of an item lie in no prior."""
    inside = _inside(collection, observations)
    return None if inside is None or not bool(inside.any(1).all()) else inside.byte().argmax(1)


def _inside(collection: Collection, observations: Sequence[Observation]) -> Tensor | None:
    """Return (N, K), whether each prior contains an item's known latents; None if its first latent is not known."""
    names = observations[0].prior.names
    if collection.latents is None or not names or names[0] not in collection.latents:
        return None
    latents = {name: torch.zeros(len(collection)) for name in names} | collection.latents
    return torch.stack([observation.prior.contains(latents) for observation in observations], 1)


def by_view(collection: Collection, observations: Sequence[Observation]) -> tuple[list[Observation], list[Collection]]:
    """Return the observations that have images, and their images: the items whose known latents a prior contains."""
    views = views_of(collection, observations)
    rows = {k: (views == k).nonzero()[:, 0] for k in views.unique().tolist()}
    return [observations[k] for k in rows], [collection.subset(found) for found in rows.values()]
