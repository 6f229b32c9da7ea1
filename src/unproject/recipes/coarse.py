"""Coarse to fine: shapes of half the size are learned first, in the same way, by the same arguments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from torch import nn

from ..networks import MultiScaleDiscriminator
from ..networks.blocks import halved_widths, upsampling_levels
from ..training import Coarse, Recipe
from .pairing import Views
from .sizes import SMALL

SHARE = 0.6
"""Of the budget for half the size, a step of which takes a quarter of the time."""


def grows(size: int | None, views: Views, channels: int, rank: int) -> bool:
    """Whether networks can begin with those of half the size: of silhouettes of at least twice the least size.

    The last doubling of planes and lines has to keep as many channels as there are.
    """
    if size is None or size < 2 * SMALL or views == "direct":
        return False
    *_, before, last = halved_widths(channels, upsampling_levels(size), rank)
    return before == last


def coarse_of(recipe: Callable[..., Recipe], arguments: Mapping[str, Any]) -> Coarse:
    """Return what trains shapes of half the size first.

    Args:
        recipe: the recipe function.
        arguments: that it was called with, those of its fields in `options`.
    """
    every = {**arguments, **arguments["options"], "size": arguments["size"] // 2}
    own = {name: value for name, value in every.items() if name not in ("options", "steps", "minutes")}
    return Coarse(partial(recipe, **own), SHARE)


def scales_of(channels: int) -> Callable[[tuple[int, ...], int], nn.Module]:
    """Return the discriminator that grows from that of half the size, of as many channels."""
    return partial(MultiScaleDiscriminator, coarsest=SMALL, channels=channels, shared=4, bottleneck=256)
