"""Prior: a distribution over the latent parameters θ of a projection."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from .._types import UserError

TURN = 2 * math.pi
GRID, SINGLE = 2**40, 2**20
"""Places in a period that are told apart; of a single value so few that rounding to float32 does not count."""


class Prior(ABC):
    """A distribution p(θ) over latents, which draws them by name and tests whether given ones lie in its support.

    Attributes:
        names: of the latents.

    Examples:
        >>> import torch, unproject as up
        >>> class Tilt(up.Prior):
        ...     names = ("tilt",)
        ...     def sample(self, n, rng):
        ...         return {"tilt": 0.1 * torch.randn(n, generator=rng)}
        ...     def contains(self, latents):
        ...         return latents["tilt"].isfinite()
        >>> up.testing.check_prior(Tilt())
    """

    names: tuple[str, ...]

    @abstractmethod
    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        """Return n draws: name → (n,) float32."""

    @abstractmethod
    def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
        """Return for each of n sets of latents whether it lies in the support, (n,) bool."""


@dataclass(frozen=True)
class Uniform(Prior):
    """The uniform distribution of one latent: θ = low + (high - low) u, u ~ U[0, 1).

    With `period`, membership is tested modulo the period, on a grid of 2⁴⁰ steps, so that adjacent bins neither leave
    gaps nor overlap.

    Raises:
        UserError: for bounds that are not finite or in the wrong order, or a period that is not positive.

    Examples:
        >>> import math, torch, unproject as up
        >>> azimuth = up.Uniform("azimuth", -0.1, 0.1, period=2 * math.pi)
        >>> azimuth.contains({"azimuth": torch.tensor([0.05, 1.0, 2 * math.pi])})
        tensor([ True, False,  True])
    """

    name: str
    low: float
    high: float
    period: float | None = None

    def __post_init__(self) -> None:
        if not (math.isfinite(self.low) and math.isfinite(self.high) and self.low <= self.high):
            raise UserError(f"Uniform({self.name!r}, {self.low}, {self.high}): give finite low <= high")
        if self.period is not None and not 0 < self.period < math.inf:
            raise UserError(f"Uniform({self.name!r}, period={self.period}): give a positive period, or None")

    @property
    def names(self) -> tuple[str, ...]:
        return (self.name,)

    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        return {self.name: self.low + (self.high - self.low) * torch.rand(n, generator=rng)}

    def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
        value = latents[self.name]
        if self.period is None:
            return (value >= self.low) & ((value < self.high) | (value == self.low))
        grid = GRID if self.low < self.high else SINGLE
        low, high = (round(edge / self.period * grid) for edge in (self.low, self.high))
        above_low = ((value.double() / self.period * grid).round().long() - low) % grid
        return (above_low < high - low) | (above_low == 0)


@dataclass(frozen=True)
class Cap(Prior):
    """Directions uniform by area on a spherical cap: cosθ = 1 - u (1 - cos most), φ = 2π v, u and v ~ U[0, 1).

    Attributes:
        polar: name of the latent θ, the angle from the pole.
        azimuth: name of the latent φ, in [0, 2π).
        most: the largest θ, radians.

    Raises:
        UserError: for `most` outside [0, π].

    Examples:
        >>> import torch, unproject as up
        >>> drawn = up.Cap("light", "light_azimuth", most=0.5).sample(1000, torch.Generator().manual_seed(0))
        >>> bool((drawn["light"] <= 0.5).all())
        True
    """

    polar: str
    azimuth: str
    most: float

    def __post_init__(self) -> None:
        if not 0 <= self.most <= math.pi:
            raise UserError(f"Cap({self.polar!r}, most={self.most:g}): give an angle from 0 to π")

    @property
    def names(self) -> tuple[str, ...]:
        return (self.polar, self.azimuth)

    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        # sin²(θ/2) is precise where cosθ is close to 1; the clamp undoes rounding above `most`.
        half = math.sin(self.most / 2) * torch.rand(n, generator=rng).sqrt()
        polar = (2 * half.asin()).clamp(max=self.most)
        return {self.polar: polar, self.azimuth: TURN * torch.rand(n, generator=rng)}

    def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
        polar = latents[self.polar]  # any azimuth is one of a full turn
        return (polar >= 0) & (polar <= self.most + 1e-6) & latents[self.azimuth].isfinite()


@dataclass(frozen=True)
class Product(Prior):
    """A product of independent priors: p(θ) = Π_j p_j(θ_j). `Product()` draws nothing, for projections without latents.

    Raises:
        UserError: if two factors draw the same latent.

    Examples:
        >>> import torch, unproject as up
        >>> prior = up.Product(up.Uniform("azimuth", 0, 6.28), up.Uniform("elevation", 0, 0.5))
        >>> prior.names
        ('azimuth', 'elevation')
    """

    factors: tuple[Prior, ...]

    def __init__(self, *factors: Prior) -> None:
        object.__setattr__(self, "factors", factors)
        if len(set(self.names)) < len(self.names):
            raise UserError(f"Product: the factors draw the same latent twice ({', '.join(self.names)})")

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(name for factor in self.factors for name in factor.names)

    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        return {name: v for factor in self.factors for name, v in factor.sample(n, rng).items()}

    def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
        n = len(next(iter(latents.values()))) if latents else 0
        inside = torch.ones(n, dtype=torch.bool)
        for factor in self.factors:
            inside = inside & factor.contains(latents)
        return inside


@dataclass(frozen=True)
class Mixture(Prior):
    """A mixture of priors of the same latents: p(θ) = Σ_k w_k p_k(θ).

    Attributes:
        parts: p_k.
        weights: w_k, brought to the sum 1 (default: equal).

    Raises:
        UserError: for no part, weights that are negative or all 0, or parts that draw different latents.

    Examples:
        >>> import unproject as up
        >>> front, back = up.Uniform("azimuth", -0.5, 0.5), up.Uniform("azimuth", 2.6, 3.6)
        >>> up.Mixture([front, back], [3, 1]).weights
        (0.75, 0.25)
    """

    parts: tuple[Prior, ...]
    weights: tuple[float, ...]

    def __init__(self, parts: Sequence[Prior], weights: Sequence[float] | None = None) -> None:
        weights = [1.0] * len(parts) if weights is None else list(weights)
        if not parts or len(weights) != len(parts) or min(weights) < 0 or sum(weights) <= 0:
            raise UserError("Mixture: give at least one part and one non-negative weight a part, not all zero")
        if len({part.names for part in parts}) != 1:
            raise UserError("Mixture: all parts must draw the same latents in the same order")
        object.__setattr__(self, "parts", tuple(parts))
        object.__setattr__(self, "weights", tuple(w / sum(weights) for w in weights))

    @property
    def names(self) -> tuple[str, ...]:
        return self.parts[0].names

    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        which = torch.multinomial(torch.tensor(self.weights), n, replacement=True, generator=rng)
        return sample_each(self.parts, which, rng)

    def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
        drawn = [part for part, weight in zip(self.parts, self.weights, strict=True) if weight > 0]
        return torch.stack([part.contains(latents) for part in drawn]).any(0)


class Bins(Mixture):
    """A uniform distribution over a period, in `count` equal adjacent bins, the first centred on `centre`.

    `bins.parts[k]` is the prior of bin k, uniform.

    Raises:
        UserError: for fewer than one bin.

    Examples:
        >>> import math, unproject as up
        >>> bins = up.Bins("azimuth", 16)
        >>> views = [up.Observation(f"view-{k}", up.Silhouette(), up.Product(azimuth, up.Uniform("elevation", 0, 0)))
        ...          for k, azimuth in enumerate(bins.parts)]
        >>> len(views), round(math.degrees(bins.parts[1].low), 2)
        (16, 11.25)
    """

    parts: tuple[Uniform, ...]

    def __init__(self, name: str, count: int, centre: float = 0.0, period: float = TURN) -> None:
        if count < 1:
            raise UserError(f"Bins({name!r}): count must be at least 1, not {count}")
        width = period / count
        super().__init__(
            [Uniform(name, centre + (k - 0.5) * width, centre + (k + 0.5) * width, period) for k in range(count)]
        )


@dataclass(frozen=True, eq=False)
class Empirical(Prior):
    """Rows of a table of latents, drawn with replacement: for example the cameras of a real collection.

    Attributes:
        table: name → (rows,).

    Raises:
        UserError: for no row, or columns of different lengths.

    Examples:
        >>> import torch, unproject as up
        >>> cameras = up.Empirical({"azimuth": torch.tensor([0.0, 1.5]), "elevation": torch.tensor([0.1, 0.3])})
        >>> bool(cameras.contains(cameras.sample(8, torch.Generator().manual_seed(0))).all())
        True
    """

    table: Mapping[str, Tensor]

    def __post_init__(self) -> None:
        lengths = {len(column) for column in self.table.values()}
        if len(lengths) != 1 or 0 in lengths:
            raise UserError("Empirical: give at least one row, and columns of one length")

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(self.table)

    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        length = len(next(iter(self.table.values())))
        rows = torch.randint(length, (n,), generator=rng)
        return {name: column.float()[rows] for name, column in self.table.items()}

    def contains(self, latents: Mapping[str, Tensor]) -> Tensor:
        known = torch.stack([self.table[name].float() for name in self.names], 1)
        asked = torch.stack([latents[name].float() for name in self.names], 1)
        _, row = torch.unique(torch.cat([known, asked]), dim=0, return_inverse=True)
        return torch.isin(row[len(known) :], row[: len(known)])


def sample_each(priors: Sequence[Prior], which: Tensor, rng: torch.Generator) -> dict[str, Tensor]:
    """Return latents whose row b is drawn from `priors[which[b]]`; all priors must draw the same latents."""
    drawn = {name: torch.empty(len(which)) for name in priors[0].names}
    for k in which.unique().tolist():
        rows = which == k
        for name, values in priors[k].sample(int(rows.sum()), rng).items():
            drawn[name][rows] = values
    return drawn


def factors_of(prior: Prior) -> tuple[Prior, ...]:
    """Return the factors of a `Product`, those of products in it included, and any other prior alone."""
    return tuple(f for part in prior.factors for f in factors_of(part)) if isinstance(prior, Product) else (prior,)
