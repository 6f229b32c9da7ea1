"""Learned latents: the distribution of a projection's latent is learned by gradient together with the generator.

The elevation of a camera, say, is unknown of each picture, but most are alike: θ = m + s ε with normal ε, limited to
what is possible. The generator's loss trains m and s through the projection, ∂y/∂θ, since the projections of
a false distribution can be told from real pictures.

References:
    Niemeyer & Geiger 2021, CAMPARI (camera distributions learned along with a generator).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from .._types import UserError


@dataclass(frozen=True)
class LearnedLatent:
    """θ = m + s ε, ε ~ N(0, 1), limited to [low, high]; m and s are learned.

    Args:
        name: of the latent; it takes the place of what priors draw by this name.
        mean, spread: m and s at the start.
        low, high: limits of θ.
        fixed_mean: learn s alone.
        rate: Adam's learning rate of m / spread and log s, β = (0.5, 0.99).

    Raises:
        UserError: for a spread or a rate that is not positive, or a mean outside the limits.

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
    rate: float = 0.01

    def __post_init__(self) -> None:
        if not (self.spread > 0 and self.rate > 0 and self.low <= self.mean <= self.high):
            raise UserError(f"{self}: give a positive spread and rate, and a mean between low and high")


class LearnedLatents(nn.Module):
    """The latents of one panel.

    Attributes:
        shift: (L,), of m from its start, in units of the initial spread. `log_scale`: (L,), of s over its start.
    """

    def __init__(self, settings: Sequence[LearnedLatent]) -> None:
        super().__init__()
        self.settings = tuple(settings)
        self.shift = nn.Parameter(torch.zeros(len(self.settings)))
        self.log_scale = nn.Parameter(torch.zeros(len(self.settings)))
        groups = [{"params": [self.shift]}, {"params": [self.log_scale]}]
        self.adam = torch.optim.Adam(groups, max((one.rate for one in settings), default=0.01), (0.5, 0.99))

    def means(self) -> Tensor:
        """Return m, (L,)."""
        start = self.shift.new_tensor([[one.mean, one.spread, 0.0 if one.fixed_mean else 1.0] for one in self.settings])
        return start[:, 0] + start[:, 1] * start[:, 2] * self.shift

    def spreads(self) -> Tensor:
        """Return s, (L,)."""
        return self.log_scale.new_tensor([one.spread for one in self.settings]) * self.log_scale.exp()

    def draw(self, n: int, rng: torch.Generator) -> dict[str, Tensor]:
        """Return n draws of each latent: name → (n,)."""
        noise = torch.randn(len(self.settings), n, generator=rng).to(self.shift)
        drawn = self.means()[:, None] + self.spreads()[:, None] * noise
        return {one.name: row.clamp(one.low, one.high) for one, row in zip(self.settings, drawn, strict=True)}

    def update(self, average_gradients: Callable[[nn.Module], None]) -> None:
        """Take a step of Adam after the backward pass of the generator's loss."""
        average_gradients(self)
        self.adam.step()
        self.adam.zero_grad()

    def log(self) -> dict[str, list[float]]:
        """Return each latent's (m, s)."""
        pairs = zip(self.settings, self.means().tolist(), self.spreads().tolist(), strict=True)
        return {one.name: [round(m, 4), round(s, 4)] for one, m, s in pairs}
