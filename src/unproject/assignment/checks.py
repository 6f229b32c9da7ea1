"""What a panel refuses and what it warns of."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence

from torch import Tensor

from .._types import UserError
from ..data import Collection
from ..data.readers.latents import LATENTS
from ..data.readers.lines import MOST_RADIANS
from ..projections.observation import Observation
from .learned_latents import LearnedLatent

BEYOND = 1.5
"""Values from which on pictures are no silhouettes; interpolation may overshoot 1 a little."""


def check_panel(
    observations: Sequence[Observation],
    collections: Sequence[Collection],
    held_out: Collection | None,
    learned: Sequence[LearnedLatent],
    weights: Mapping[str, float],
) -> None:
    """Raise UserError for what no panel can be made of; warn of values in other units."""
    if not observations:
        raise UserError("panel: give at least one observation")
    projection = observations[0].projection
    names = ", ".join(repr(o.name) for o in observations)
    if any(o.projection != projection for o in observations):
        raise UserError(
            f"panel of {names}: its observations must share one projection; make it once and give it to each, or "
            "give each a panel of its own"
        )
    if len(collections) not in (1, len(observations)):
        raise UserError(
            f"panel of {names}: {len(collections)} collections for {len(observations)} observations; "
            "give one for all, or one for each"
        )
    if len({c.shape for c in (*collections, *([held_out] if held_out else []))}) > 1:
        raise UserError(f"panel of {names}: its images differ in size; give each size a panel of its own")
    taken = {*projection.latents, *projection.optional_latents}
    named = [one.name for one in learned]
    if not taken.issuperset(named) or len(set(named)) < len(named):
        raise UserError(
            f"panel of {names}: learned={named}: give latents of the projection, {sorted(taken)}, once each"
        )
    for name, value in weights.items():
        if not 0 < value < math.inf:
            raise UserError(f"panel of {names}: {name}={value:g}: must be positive")
    for found in collections:
        _warn_of_units(found, projection.silhouettes, names)


def _warn_of_units(found: Collection, silhouettes: bool, names: str) -> None:
    """Warn of silhouettes beyond 1, and of angles that no radians are."""
    values, latents = found.stored, found.latents or {}
    if silhouettes and isinstance(values, Tensor) and values.is_floating_point():
        highest = values.max().item()
        if highest > BEYOND:
            warnings.warn(f"panel of {names}: silhouettes run to {highest:g}, not to 1; divide them", stacklevel=5)
    for name in LATENTS.keys() & latents.keys():
        if latents[name].abs().max() > MOST_RADIANS:
            warnings.warn(f"panel of {names}: {name} is beyond 4 π; give radians, not degrees", stacklevel=5)
