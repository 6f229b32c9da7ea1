"""The laws of projections, priors and generators, for the parts of this package and for a user's own.

A law is a statement, the likely cause of its violation, and a test. `check_*` raises `LawError` with every broken law;
`run_laws` returns all results, as `unproject check` prints them.
"""

from __future__ import annotations

import math
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


def check_projection(
    part: Projection | type[Projection] | Observation, example: Tensor | None = None, seed: int = 0
) -> None:
    """Test the laws of a projection.

    Args:
        part: a projection, whose latents are drawn from U[0, 1), or an observation, whose prior is tested too.
        example: a batch of x (default: three random ones of the projection's `example_shape`, values in [0, 1]).
        seed: of the random draws.

    Raises:
        LawError: naming each broken law, what was measured and the likely cause.

    Examples:
        >>> import torch, unproject as up
        >>> class Sum(up.Projection):
        ...     linear = True
        ...     def forward(self, x):
        ...         return x.sum(3)
        >>> up.testing.check_projection(Sum())
        >>> class Normalised(Sum):
        ...     def forward(self, x):
        ...         return x.sum(3) / x.mean()
        >>> up.testing.check_projection(Normalised())
        Traceback (most recent call last):
        ...
        unproject.testing.laws.LawError: Normalised breaks 4 of 11 laws tried
        ...
    """
    part = part() if isinstance(part, type) else part
    if isinstance(part, Observation):
        check_prior(part.prior, seed)
    projection = part.projection if isinstance(part, Observation) else part
    raise_broken(projection, apply_laws(PROJECTION_LAWS, projection_case(part, example, seed)))


def check_prior(prior: Prior, seed: int = 0) -> None:
    """Test the laws of a prior.

    Raises:
        LawError: naming each broken law, what was measured and the likely cause.

    Examples:
        >>> import unproject as up
        >>> up.testing.check_prior(up.Bins("azimuth", 16))
    """
    raise_broken(prior, apply_laws(PRIOR_LAWS, PriorCase(prior, seed)))


def check_generator(generator: nn.Module, seed: int = 0, low: float = 0.0, high: float = 1.0) -> None:
    """Test the laws of a generator, a module with `draw(n, rng)` and `sample(n, seed)`.

    Args:
        generator: the module.
        seed: of the random draws.
        low, high: the range of its values.

    Raises:
        LawError: naming each broken law, what was measured and the likely cause.

    Examples:
        >>> import unproject as up
        >>> up.testing.check_generator(up.networks.ImageGenerator(size=8, code_size=4, channels=8))
    """
    raise_broken(generator, apply_laws(GENERATOR_LAWS, generator_case(generator, seed, low, high)))


RANGES = {"volumes": (0.0, 1.0), "images": (0.0, 1.0), "maps": (-1.0, math.inf)}
"""Domain of a generator → values of its samples; those of a domain of one's own may be any."""


def run_laws(part: Any, seed: int = 0) -> list[LawResult]:
    """Test the laws of a projection, an observation (with its prior), a prior or a generator; return all results.

    Raises:
        UserError: for anything else.

    Examples:
        >>> import unproject as up
        >>> results = up.testing.run_laws(up.Uniform("angle", 0, 1))
        >>> [result.name for result in results if result.passed]
        ['names', 'shape', 'dtype', 'finite', 'deterministic', 'support']
    """
    if isinstance(part, Observation):
        return run_laws(part.prior, seed) + apply_laws(PROJECTION_LAWS, projection_case(part, None, seed))
    if isinstance(part, Projection):
        return apply_laws(PROJECTION_LAWS, projection_case(part, None, seed))
    if isinstance(part, Prior):
        return apply_laws(PRIOR_LAWS, PriorCase(part, seed))
    if isinstance(part, nn.Module) and hasattr(part, "draw"):
        low, high = RANGES.get(getattr(part, "domain", "images"), (-math.inf, math.inf))
        return apply_laws(GENERATOR_LAWS, generator_case(part, seed, low, high))
    raise UserError(f"{part!r} is no Projection, Observation, Prior or generator module; give one of these")
