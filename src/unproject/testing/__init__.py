"""The laws that projections, priors and generators obey, for the shipped parts and for a user's own.

Each law is one line of a table: what must hold, what it looks like when it does not, and a test. `check_*` raises
`LawError` with every broken law; `run_laws` returns all the results, as `unproject check` prints them.
"""

from __future__ import annotations

from typing import Any

from torch import Tensor, nn

from .._types import UserError
from ..projections.base import Projection
from ..projections.observation import Observation
from ..projections.priors import Prior
from .generators import GENERATOR_LAWS, generator_case
from .laws import Law, LawError, LawResult, apply_laws, raise_broken
from .priors import PRIOR_LAWS, PriorCase
from .projections import PROJECTION_LAWS, projection_case

__all__ = [
    "GENERATOR_LAWS",
    "PRIOR_LAWS",
    "PROJECTION_LAWS",
    "Law",
    "LawError",
    "LawResult",
    "check_generator",
    "check_prior",
    "check_projection",
    "run_laws",
]


def check_projection(part: Projection | Observation, example: Tensor | None = None, seed: int = 0) -> None:
    """Test the laws of a projection.

    Args:
        part: a projection, its latents then drawn from U[0, 1); or an observation, which draws its own.
        example: a batch of x; by default three random ones of the projection's `example_shape`, values in [0, 1].

    Raises:
        LawError: naming each broken law, what was measured and the likely cause.
    """
    raise_broken(part, apply_laws(PROJECTION_LAWS, projection_case(part, example, seed)))


def check_prior(prior: Prior, seed: int = 0) -> None:
    """Test the laws of a prior; raises `LawError`."""
    raise_broken(prior, apply_laws(PRIOR_LAWS, PriorCase(prior, seed)))


def check_generator(generator: nn.Module, seed: int = 0, low: float = 0.0, high: float = 1.0) -> None:
    """Test the laws of a generator, a module with `draw(n, rng)` and `sample(n, seed)`; raises `LawError`.

    Args:
        low, high: the range its values must keep to.
    """
    raise_broken(generator, apply_laws(GENERATOR_LAWS, generator_case(generator, seed, low, high)))


def run_laws(part: Any, seed: int = 0) -> list[LawResult]:
    """All laws that apply to a projection, an observation (with its prior), a prior or a generator."""
    if isinstance(part, Observation):
        return run_laws(part.prior, seed) + apply_laws(PROJECTION_LAWS, projection_case(part, None, seed))
    if isinstance(part, Projection):
        return apply_laws(PROJECTION_LAWS, projection_case(part, None, seed))
    if isinstance(part, Prior):
        return apply_laws(PRIOR_LAWS, PriorCase(part, seed))
    if isinstance(part, nn.Module):
        return apply_laws(GENERATOR_LAWS, generator_case(part, seed, 0.0, 1.0))
    raise UserError(f"{part!r} is none of Projection, Observation, Prior or generator module; give one of those")
