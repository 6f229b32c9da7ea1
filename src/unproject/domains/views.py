"""Views of observations: their bins, and how many turns of a sample explain the same data."""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F

from .._random import generator_at
from ..projections.observation import Observation
from ..projections.priors import Prior, factors_of

ANY = 16
"""Turns that are tried where views are not in bins."""


def view_bins(observations: Sequence[Observation]) -> int:
    """Return the number of bins of the first latent; bands of elevation share them."""
    return len(_first_factors([observation.prior for observation in observations]))


def free_turns(observations: Sequence[Observation], half: bool) -> int:
    """Return how many turns of a sample explain the same data where views are unknown.

    Any turn by a bin does; with views that are not in bins any turn does. Directions that cover half a turn make twice
    as many turns, and so does an odd number of bins, which a reflection does not map to bins.
    """
    parts = getattr(observations[0].prior, "parts", ())
    bins = view_bins(observations) if len(observations) > 1 else len(_first_factors(parts)) or ANY
    return 2 * bins if half or bins % 2 else bins


def cover_half_a_turn(observations: Sequence[Observation]) -> bool:
    """Whether none of these directions, the first latent in radians, is opposite to another."""
    name = observations[0].prior.names[0]
    draws = [o.prior.sample(64, generator_at(0, i, "angles"))[name] for i, o in enumerate(observations)]
    middles = F.normalize(torch.stack([torch.stack([draw.cos(), draw.sin()]).mean(1) for draw in draws]), dim=1)
    return not bool((middles @ middles.T < -0.95).any())


def _first_factors(priors: Sequence[Prior]) -> set[Prior]:
    """Return the different priors of the first latent."""
    return {factors_of(prior)[0] for prior in priors}
