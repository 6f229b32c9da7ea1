"""Learned latents: the distribution of a projection's latent is learned by gradient together with the generator.

The elevation of a camera, say, is unknown of each picture, but most are alike: θ = m + s ε with normal ε, limited to
what is possible. The generator's loss trains m and s through the projection, ∂y/∂θ, since the projections of
a false distribution can be told from real pictures.

References:
    Niemeyer & Geiger 2021, CAMPARI (camera distributions learned along with a generator).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from .._types import UserError
from .context import Processes


@dataclass(frozen=True)
class LearnedLatent:
    """θ = m + s ε, ε ~ N(0, 1), within [low, high]; m and s are learned.

    Args:
        name: of the latent; it takes the place of what priors draw by this name.
        mean, spread: m and s at the start.
        low, high: limits of θ; what is below `low` is reflected there, what is above `high` becomes `high`.
        fixed_mean: learn s alone.
        begin: the part of the budget after which it is learned. Until then priors draw it, or it is left out where it
            is optional. Latents of more effect come first: elevations of any spread explain pictures of any width.
        negligible: if |m| + s falls below it, θ is 0 from then on; projections with θ = 0 may be faster.
        rate: Adam's learning rate of log s, and of m in units of `spread`, β = (0.5, 0.99).

    Raises:
        UserError: for a spread or a rate that is not positive, a mean outside the limits, or what is no name.

    Examples:
        >>> import unproject as up
        >>> up.LearnedLatent("elevation", mean=0.15, spread=0.1, low=-0.3, high=1.2).name
        'elevation'
    """

    name: str
    mean: float
    spread: float
    low: float = -math.inf
    high: float = math.inf
    fixed_mean: bool = False
    begin: float = 0.0
    negligible: float = 0.0
    rate: float = 0.01

    def __post_init__(self) -> None:
        sensible = self.spread > 0 and self.rate > 0 and self.low <= self.mean <= self.high
        sensible = sensible and (self.negligible == 0 or self.low <= 0 <= self.high)
        if not (sensible and self.name.isidentifier() and 0 <= self.begin < 1):
            raise UserError(
                f"{self}: give a name, a positive spread and rate, a mean between low and high, "
                "a begin below 1, and no `negligible` where 0 is outside the limits"
            )

    def draw(self, m: Tensor, s: Tensor, n: int, rng: torch.Generator) -> Tensor:
        """Return n draws; without gradient, so that it stays so, if they are negligible."""
        if m.abs() + s < self.negligible:
            return torch.zeros(n, dtype=m.dtype, device=m.device)
        return self.limited(m + s * torch.randn(n, generator=rng).to(m))

    def limited(self, values: Tensor) -> Tensor:
        """Return values (N,) within the limits; reflected at `low`, all have a gradient there."""
        if math.isfinite(self.low):
            values = self.low + (values - self.low).abs()
        return values.clamp(max=self.high)


class LearnedLatents(nn.Module):
    """The latents of one panel; the checkpoint holds `NAME.mean`, `NAME.log_spread` and whether it has `begun`."""

    def __init__(self, settings: Sequence[LearnedLatent]) -> None:
        super().__init__()
        self.settings = tuple(settings)
        self.latents = nn.ModuleDict({one.name: _numbers(one) for one in self.settings})
        groups: list[dict[str, Any]] = []
        for one in self.settings:
            numbers = self._numbers(one)
            groups.append({"params": [numbers["log_spread"]], "lr": one.rate})
            if not one.fixed_mean:
                groups.append({"params": [numbers["mean"]], "lr": one.rate * one.spread})
        self.adam = torch.optim.Adam(groups, betas=(0.5, 0.99))

    def _numbers(self, one: LearnedLatent) -> nn.ParameterDict:
        numbers = self.latents[one.name]
        assert isinstance(numbers, nn.ParameterDict)
        return numbers

    def advance(self, progress: float) -> None:
        """Begin with those whose part of the budget is spent; what has begun in another run stays so."""
        for one in self.settings:
            if progress >= one.begin:
                self._numbers(one)["begun"].data.fill_(1)

    def _own(self) -> Iterator[tuple[LearnedLatent, Tensor, Tensor]]:
        """Yield each latent that is learned by now, with its m and s."""
        for one in self.settings:
            numbers = self._numbers(one)
            if numbers["begun"]:
                yield one, numbers["mean"], numbers["log_spread"].exp()

    def draw(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        """Return n draws of each latent that is learned by now: name → (n,)."""
        return {one.name: one.draw(m, s, n, rng) for one, m, s in self._own()}

    def update(self, processes: Processes) -> None:
        """Take a step of Adam after the backward pass of the generator's loss."""
        processes.average_gradients(self)
        self.adam.step()
        self.adam.zero_grad()

    def log(self) -> dict[str, list[float]]:
        """Return (m, s) of each latent."""
        return {one.name: [round(m.item(), 4), round(s.item(), 4)] for one, m, s in self._own()}


def _numbers(one: LearnedLatent) -> nn.ParameterDict:
    """Return m, log s and 0, since it has not begun."""
    numbers = nn.ParameterDict({"mean": torch.tensor(one.mean), "log_spread": torch.tensor(math.log(one.spread))})
    numbers["mean"].requires_grad_(not one.fixed_mean)
    numbers["begun"] = nn.Parameter(torch.tensor(0.0), requires_grad=False)
    return numbers
