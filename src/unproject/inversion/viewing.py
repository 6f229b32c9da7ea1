"""Viewing: how pictures came about whose view is not known, or in part: P, and the priors of its latents in bins."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ..data.readers.lines import MOST_RADIANS
from ..projections.base import Projection
from ..projections.observation import Observation, exact
from ..projections.priors import Prior, factors_of, sample_each

Latents = Mapping[str, Tensor]
TURNS = ("azimuth", "angle", "roll")
"""Latents that turn a sample or the camera, of any number of turns."""


@dataclass(frozen=True)
class Viewing:
    """y = P(x, θ), θ ~ p_k, k one of K bins.

    Attributes:
        projection: P.
        priors: p_k.
        learned: (n, rng) → draws of the latents whose distribution was learned, in place of the priors'.

    Examples:
        >>> import torch, unproject as up
        >>> viewing = Viewing.of(up.projections.azimuth_bins(4, up.Silhouette(size=16)))
        >>> viewing.possible({"azimuth": torch.tensor([0.0, 3.14])}, 2).int()
        tensor([[1, 0, 0, 0],
                [0, 0, 1, 0]], dtype=torch.int32)
    """

    projection: Projection
    priors: tuple[Prior, ...]
    learned: Callable[[int, torch.Generator], dict[str, Tensor]] | None = None

    @classmethod
    def of(
        cls,
        observations: Sequence[Observation],
        learned: Callable[[int, torch.Generator], dict[str, Tensor]] | None = None,
    ) -> Viewing:
        """Return the viewing of observations that share a projection."""
        return cls(observations[0].projection, tuple(observation.prior for observation in observations), learned)

    @property
    def names(self) -> tuple[str, ...]:
        """The latents that are drawn."""
        rng = torch.Generator().manual_seed(0)
        return tuple({**dict.fromkeys(self.priors[0].names), **(self.learned(1, rng) if self.learned else {})})

    def is_known(self, known: Latents) -> bool:
        """Whether nothing of the views is left to be found."""
        return set(self.names) <= set(known)

    def possible(self, known: Latents, count: int) -> Tensor:
        """Return (count, K), whether each picture can be of each bin, by what is known of its latents.

        A latent that lies in no bin says nothing, since gaps between bins are no reason to refuse a picture.
        """
        inside = torch.ones(count, len(self.priors), dtype=torch.bool)
        factors = [factors_of(prior) for prior in self.priors]
        for name in known:
            found = torch.ones_like(inside)
            for k, factor in ((k, factor) for k, some in enumerate(factors) for factor in some):
                if name in factor.names and set(factor.names) <= set(known):
                    found[:, k] &= factor.contains(known)
            inside &= found | ~found.any(1, keepdim=True)
        return inside | ~inside.any(1, keepdim=True)

    def outside(self, known: Latents) -> tuple[str, ...]:
        """Return the known latents that are outside what was trained on: angles that are degrees, or others in no bin.

        Of turns, which may lie between bins, the size alone tells; of others the priors that draw nothing else do.
        """
        factors = [factor for prior in self.priors for factor in factors_of(prior)]
        found = []
        for name, value in known.items():
            if name in TURNS:
                inside = value.abs() <= MOST_RADIANS
            else:
                told = [factor.contains(known) for factor in factors if factor.names == (name,)]
                inside = torch.stack(told).any(0) if told else torch.ones_like(value)
            if not bool(inside.all()):
                found.append(name)
        return tuple(found)

    def draw(self, bins: Tensor, known: Latents, rng: torch.Generator) -> dict[str, Tensor]:
        """Return latents (B,) of these bins (B,); those that are known, (B,) each, as they are."""
        drawn = sample_each(self.priors, bins, rng) if self.priors[0].names else {}
        drawn |= self.learned(len(bins), rng) if self.learned else {}
        return {name: value.detach() for name, value in drawn.items()} | dict(known)

    def project(self, x: Tensor, theta: Latents) -> Tensor:
        """Return y = P(x, θ)."""
        return self.projection(x, **{name: exact(value, x) for name, value in theta.items()})
