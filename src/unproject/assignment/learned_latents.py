"""Learned latents: the distribution of a projection's latent is learned by gradient together with the generator.

The elevation of a camera, say, is unknown of each picture, but most are alike: θ = m + s ε with normal ε, limited to
what is possible. The generator's loss trains m and s through the projection, ∂y/∂θ, since the projections of
a false distribution can be told from real pictures.

References:
    Niemeyer & Geiger 2021, CAMPARI (camera distributions learned along with a generator).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from .._types import UserError


@dataclass(frozen=True)
class LearnedLatent:
    """θ = m + s ε, ε ~ N(0, 1), within [low, high]; m and s are learned.

    Args:
        name: of the latent; it takes the place of what priors draw by this name.
        mean, spread: m and s at the start.
        low, high: limits of θ; what is below `low` is reflected there, what is above `high` becomes `high`.
        fixed_mean: learn s alone.
        begin: the part of the budget from which on it is learned; until then priors draw it, or it is left out. What
            latents of more effect hold is found first: elevations of any spread explain pictures of any width.
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
        if not (sensible and self.name.isidentifier() and 0 <= self.begin < 1):
            raise UserError(
                f"{self}: give a name, a positive spread and rate, a mean between low and high, and a begin below 1"
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
    """The latents of one panel; the checkpoint holds `NAME.mean` and `NAME.log_spread` of each.

    Attributes:
        progress: the part of the budget that is spent.
    """

    progress: Tensor

    def __init__(self, settings: Sequence[LearnedLatent]) -> None:
        super().__init__()
        self.settings = tuple(settings)
        groups = []
        for one in self.settings:
            own = nn.ParameterDict({"mean": torch.tensor(one.mean), "log_spread": torch.tensor(math.log(one.spread))})
            self.add_module(one.name, own)
            groups.append({"params": [own["log_spread"]], "lr": one.rate})
            if one.fixed_mean:
                own["mean"].requires_grad_(False)
            else:
                groups.append({"params": [own["mean"]], "lr": one.rate * one.spread})
        self.adam = torch.optim.Adam(groups, betas=(0.5, 0.99))
        self.register_buffer("progress", torch.tensor(0.0, dtype=torch.float64))

    def _own(self) -> Iterator[tuple[LearnedLatent, Tensor, Tensor]]:
        """Yield each latent that is learned by now, with its m and s."""
        for one in self.settings:
            if self.progress < one.begin:
                continue
            own = self.get_submodule(one.name)
            assert isinstance(own, nn.ParameterDict)
            yield one, own["mean"], own["log_spread"].exp()

    def draw(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        """Return n draws of each latent that is learned by now: name → (n,)."""
        return {one.name: one.draw(m, s, n, rng) for one, m, s in self._own()}

    def update(self, average_gradients: Callable[[nn.Module], None]) -> None:
        """Take a step of Adam after the backward pass of the generator's loss."""
        average_gradients(self)
        self.adam.step()
        self.adam.zero_grad()

    def log(self) -> dict[str, list[float]]:
        """Return (m, s) of each latent."""
        return {one.name: [round(m.item(), 4), round(s.item(), 4)] for one, m, s in self._own()}
