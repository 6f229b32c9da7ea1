"""Candidates: samples of a generator and their projections, made once for all pictures."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError
from ..networks import Generator
from .latent_space import LatentSpace
from .viewing import Latents, Viewing

CHUNK = 64
"""Samples generated, and projections made, at once."""
MIN_VARIANCE = 1e-8
"""The variance of a pixel, at least."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """C samples, and their projections in views of which nothing is known.

    Args:
        generator: in evaluation mode.
        viewing: how pictures come about.
        count: C.
        seed: of the samples and views.
        repeated: (x, times) → samples, each `times` in a row (`Domain.repeated`).
    """

    generator: Generator
    viewing: Viewing
    count: int
    seed: int
    repeated: Callable[[Tensor, int], Tensor]

    @cached_property
    def space(self) -> LatentSpace:
        """The whitened latents of the generator."""
        return LatentSpace.of(self.generator, self.seed)

    @cached_property
    @torch.no_grad()
    def latents(self) -> Tensor:
        """Whitened latents (C, r)."""
        codes = self.generator.draw(self.count, generator_at(self.seed, 0, "candidates"))
        device = next(self.generator.parameters()).device
        return self.space.whitened(self.generator.map_code(codes.to(device)))

    @cached_property
    @torch.no_grad()
    def x(self) -> Tensor:
        """Samples (C, ...)."""
        return torch.cat([self.synthesise(v) for v in self.latents.split(CHUNK)])

    @cached_property
    def views(self) -> dict[str, Tensor]:
        """Latents (C, K) of the projections: a draw in each bin."""
        bins = torch.arange(len(self.viewing.priors)).repeat(self.count)
        return rows(self.viewing.draw(bins, {}, generator_at(self.seed, 0, "views of candidates")), self.count)

    @cached_property
    @torch.no_grad()
    def projections(self) -> Tensor:
        """(C, K, ...)."""
        return self.project(self.x, self.views, len(self.viewing.priors))

    @cached_property
    def variance(self) -> float:
        """σ², the mean variance of a pixel among the projections.

        Raises:
            UserError: if there is but one.
        """
        if self.count * len(self.viewing.priors) < 2:
            raise UserError(f"candidates={self.count}: give at least 2 where there is one view")
        return max(self.projections.flatten(0, 1).var(0).mean().item(), MIN_VARIANCE)

    def synthesise(self, v: Tensor) -> Tensor:
        """Return the samples (B, ...) of whitened latents (B, r)."""
        return self.generator.synthesise(self.space.latents(v))

    def project(self, x: Tensor, theta: Latents, count: int) -> Tensor:
        """Return projections (S, count, ...) of x (S, ...) in views (S, count), some at once."""
        at_once, parts = max(1, CHUNK // count), []
        for start in range(0, len(x), at_once):
            some = slice(start, start + at_once)
            flat = {name: value[some].flatten() for name, value in theta.items()}
            parts.append(self.viewing.project(self.repeated(x[some], count), flat).unflatten(0, (-1, count)))
        return torch.cat(parts)

    def distance(self, projected: Tensor, pictures: Tensor) -> Tensor:
        """Return mean squared differences of projections (S, M, ...) from pictures (M, ...) over σ², (S, M)."""
        return (projected - pictures).square().flatten(2).mean(2) / self.variance


def rows(theta: Latents, count: int) -> dict[str, Tensor]:
    """Return latents (S M,) as (S, M), with S = count."""
    return {name: value.view(count, -1) for name, value in theta.items()}


def each(theta: Latents, count: int) -> dict[str, Tensor]:
    """Return latents (M,) of pictures for each of `count` samples, (S M,)."""
    return {name: value.repeat(count) for name, value in theta.items()}
