"""Initial views of silhouettes, from the one shape that explains them all best.

An untrained generator and an untrained view predictor can agree on shapes that look the same from every side: wide ones
for wide silhouettes and narrow ones for narrow silhouettes, so that views stay indistinguishable. The mean silhouettes
are enough to distinguish front from side, and need no network.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
import torch.nn.functional as F
from torch import Tensor

from .._random import generator_at
from .._types import UserError
from ..ops.rotation import quarter_turn
from ..projections.observation import Observation
from ..projections.priors import sample_each
from .responsibilities import balanced

SIDE = 16  # voxels of the shape, and pixels of what is compared
REACH = 0.6  # radius of the ball that it starts as, in half widths of the volume
UNEVEN = 0.1  # deviation of its logits at the start: what makes one try differ from another
ANNEALED = 0.8  # part of the iterations after which the temperature stays
DRAWS = 8  # of each view's prior, over which a fitted shape's squared errors are averaged


@dataclass(frozen=True)
class MeanShapeInitialiser:
    """y = P_k(x̄) + ε for one shape x̄, no view rare: p(k | y) ∝ exp(-|y - P_k(x̄)|² / τ), by annealed EM.

    Each iteration computes responsibilities from the current shape (E), and moves the shape's projection in each view
    towards the mean of the silhouettes weighted by them, by a step of Adam on its logits (M). τ falls from `hot` to
    `cold`, evenly in its logarithm. Several fits start from uneven balls, and the likeliest is kept. With `mirror` each
    is also fitted from its quarter turn, with τ from `warm`: an elongated shape may lie along the plane of symmetry or
    across it, and the difference shows late.

    Args:
        mirror: the shape is symmetric left to right. Set it as the generator's is, so that views agree with its
            plane of symmetry.
        images: how many the shape is fitted to; the others get their responsibilities from it.
        tries: balls to start from.
        iterations: of each fit.
        hot, warm, cold: τ at the start, after a quarter turn, and at the end, in pixels of silhouettes 16 pixels a
            side. Neighbouring pixels err together, so it is far above twice the variance of one.
        balance: how far the view distribution is moved to the uniform one, 0 (not) to 1.

    Level views of 32² take some eight seconds of one core; tilted ones about three times as long.

    References:
        EM with views as latent variables: Scheres et al. 2007; from no reference at all, by stochastic steps: Punjani
        et al. 2017 (cryoSPARC). Annealing: Ueda and Nakano 1998.

    Examples:
        >>> import unproject as up
        >>> views = up.projections.azimuth_bins(4, up.Silhouette(size=16))
        >>> silhouettes = up.data.observe(up.data.cars(6, 16), views, each=2)
        >>> initialiser = up.MeanShapeInitialiser(tries=1, iterations=2)
        >>> initialiser(views, silhouettes.floats(), 0).shape
        torch.Size([12, 4])
    """

    mirror: bool = False
    images: int = 2000
    tries: int = 2
    iterations: int = 300
    hot: float = 60.0
    warm: float = 6.0
    cold: float = 1.5
    balance: float = 1.0

    def __post_init__(self) -> None:
        temperatures = 0 < self.cold <= self.warm <= self.hot
        if min(self.images, self.tries, self.iterations) < 1 or not temperatures or not 0 <= self.balance <= 1:
            raise UserError(
                f"{self}: give at least 1 image, try and iteration, and 0 < cold <= warm <= hot, balance 0 to 1"
            )

    def __call__(self, observations: Sequence[Observation], items: Tensor, seed: int) -> Tensor:
        """Return p(k | y), (N, K), of square silhouettes (N, 1, D, D), on the CPU.

        Raises:
            UserError: if these are not silhouettes.
        """
        silhouettes = items.dim() == 4 and items.shape[1] == 1 and items.shape[2] == items.shape[3]
        if not silhouettes or "azimuth" not in observations[0].prior.names:
            raise UserError(
                "MeanShapeInitialiser: takes silhouettes from different sides; use another initialiser, or none"
            )
        pictures = pooled(items.cpu().float())
        rows = torch.randperm(len(pictures), generator=generator_at(seed, 0, "silhouettes"))[: self.images]
        fits: list[Fitted] = []
        for number in range(self.tries):
            ball = uneven_ball(generator_at(seed, number, "ball"))
            fits.append(self.fit(observations, pictures[rows], ball, self.hot, seed))
            if self.mirror:
                turned = quarter_turn(fits[-1].logits[None], 1)[0]
                fits.append(self.fit(observations, pictures[rows], turned, self.warm, seed))
        best = max(fits, key=lambda fitted: fitted.log_likelihood)
        responsibilities = (-mismatch(pictures, observations, best.logits, seed) / self.cold).softmax(1)
        return balanced(responsibilities, self.balance)

    def fit(
        self, observations: Sequence[Observation], pictures: Tensor, logits: Tensor, heat: float, seed: int
    ) -> Fitted:
        """Fit a shape to pictures (N, 256) from `logits` (X, Y, Z), with τ from `heat` to `cold`."""
        logits = logits.clone().requires_grad_()
        adam = torch.optim.Adam([logits], 0.1, (0.8, 0.95))
        for step in range(self.iterations):
            rng = generator_at(seed, step, "looks at the mean shape")
            seen = projections(observations, self._symmetric(logits), rng)
            now = heat * (self.cold / heat) ** min(1.0, step / (ANNEALED * self.iterations))
            with torch.no_grad():
                responsibilities = balanced((-squares(pictures, seen) / now).softmax(1), self.balance, 10)
                mass = responsibilities.sum(0)
                mean = responsibilities.T @ pictures / mass.clamp_min(1e-6)[:, None]
            loss = (mass @ (seen - mean).square().sum(1)) / len(pictures)
            adam.zero_grad()
            loss.backward()
            adam.step()
        found = self._symmetric(logits.detach())
        errors = mismatch(pictures, observations, found, seed)
        return Fitted(found, float((-errors / self.cold).logsumexp(1).mean()))

    def _symmetric(self, logits: Tensor) -> Tensor:
        return (logits + logits.flip(0)) / 2 if self.mirror else logits


class Fitted(NamedTuple):
    """The logits of a shape (X, Y, Z), and the mean of log Σ_k exp(-|y - P_k(x̄)|² / τ): the best has the largest."""

    logits: Tensor
    log_likelihood: float


def pooled(pictures: Tensor) -> Tensor:
    """Return pictures (N, 1, H, W) at 16 pixels a side, flattened: (N, 256)."""
    return F.adaptive_avg_pool2d(pictures, SIDE).flatten(1)


def uneven_ball(rng: torch.Generator) -> Tensor:
    """Return the logits (X, Y, Z) of a soft, slightly uneven ball in the middle."""
    middles = (torch.arange(SIDE) + 0.5) / SIDE * 2 - 1
    squared = sum(axis.square() for axis in torch.meshgrid(middles, middles, middles, indexing="ij"))
    return 8 * (REACH**2 - squared) + UNEVEN * torch.randn(SIDE, SIDE, SIDE, generator=rng)


def projections(observations: Sequence[Observation], logits: Tensor, rng: torch.Generator) -> Tensor:
    """Return one projection of the shape of these logits (X, Y, Z) in every view, (K, 256)."""
    views = torch.arange(len(observations))
    theta = sample_each([observation.prior for observation in observations], views, rng)
    return pooled(observations[0].projection(logits.sigmoid().expand(len(views), -1, -1, -1), **theta))


def squares(pictures: Tensor, seen: Tensor) -> Tensor:
    """Return |y_n - s_k|², (N, K)."""
    return pictures.square().sum(1)[:, None] - 2 * pictures @ seen.T + seen.square().sum(1)


def mismatch(pictures: Tensor, observations: Sequence[Observation], logits: Tensor, seed: int) -> Tensor:
    """Return |y - P_k(x)|², (N, K), averaged over `DRAWS` draws from each view's prior."""
    draws = [
        projections(observations, logits, generator_at(seed, draw, "looks at the fitted shape"))
        for draw in range(DRAWS)
    ]
    return torch.stack([squares(pictures, seen) for seen in draws]).mean(0)
