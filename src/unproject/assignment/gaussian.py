"""Initial directions of line integrals, from the Gaussian of images that explains all lines best.

An untrained generator and an untrained view predictor can agree on images that are turned against one another, each of
which explains its own lines. The second-order statistics of all lines are enough to turn most of them the same way, and
need no network.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError
from ..projections.observation import Observation
from .responsibilities import balanced

POINTS = 20  # blobs on a ring
REACH = 0.72  # radius of the outermost ring, in half widths of the image
DRAWS = 8  # of each direction's prior, over which its matrix is averaged
COOLING = 0.97  # of the temperature, an iteration
RIDGE = 1e-7  # on the diagonal of Σ


@dataclass(frozen=True)
class GaussianInitialiser:
    """x ~ N(μ, Σ), y = A_k x + ε, ε ~ N(0, s²), directions k equally frequent: p(k | y) by annealed EM.

    x are the weights of blobs on rings and A_k their line integrals in direction k: all directions are treated alike.
    The directions lie in order around a whole turn, and the lines were measured in some unknown half of it:

    1. μ and Σ are kept the same under half a turn of the image. Then no line differs from itself read backwards, any
       rotation or reflection of a solution is one too, and annealing finds the directions up to half a turn.
    2. Given those, the half is the one that makes lines and directions together likeliest; a few more iterations,
       free of the symmetry, follow. The half may be wrong by one direction, which `Estimator(window=...)` corrects.

    Args:
        lines: how many the Gaussian is fitted to; the others get their responsibilities from it.
        annealed, fixed, free: iterations of stage 1, of stage 2 for every half, and after it.
        heat: the probabilities of stage 1 are drawn to equal ones by the power 1 / heat at first.
        noise: s, in deviations of the readings.

    References:
        EM for mixtures of factor analysers (Ghahramani and Hinton 1996), with one distribution behind all of them;
        annealing of its first step (Ueda and Nakano 1998).

    Examples:
        >>> import unproject as up
        >>> around = up.projections.directions(4, 0.02, whole=True)
        >>> lines = up.data.observe(up.data.digits(16)[:64], around[:4])
        >>> initialiser = up.GaussianInitialiser(annealed=2, fixed=1, free=1)
        >>> initialiser(around, lines.floats(), 0).shape
        torch.Size([64, 8])
    """

    lines: int = 12_000
    annealed: int = 340
    fixed: int = 20
    free: int = 60
    heat: float = 40.0
    noise: float = 0.35

    def __post_init__(self) -> None:
        if min(self.lines, self.annealed, self.fixed, self.free) < 1 or self.heat < 1 or self.noise <= 0:
            raise UserError(f"{self}: give at least 1 line, 1 iteration of each kind, a heat of 1 and some noise")

    def __call__(self, observations: Sequence[Observation], items: Tensor, seed: int) -> Tensor:
        """Return p(k | y), (N, K), of lines (N, 1, D) for an even number K of directions around a whole turn.

        Raises:
            UserError: if these are not line integrals, all readings are equal, or the number of directions is odd.
        """
        if items.dim() != 3 or items.shape[1] != 1 or not observations[0].projection.linear or len(observations) % 2:
            raise UserError(
                "GaussianInitialiser: takes line integrals in directions around a turn; use another initialiser"
            )
        lines = items[:, 0].float()
        if not lines.std() > 0:
            raise UserError("GaussianInitialiser: all readings are equal; give lines of something")
        rows = torch.randperm(len(lines), generator=generator_at(seed, 0, "lines"))[: self.lines]
        half = len(observations) // 2
        operators = blob_projections(observations, lines.shape[1], seed)
        start = isotropic(operators, lines, self.noise * float(lines.std()), seed)

        even, found = fit(lines[rows], operators[:half], start, self.annealed, heat=self.heat, even=True)
        likeliest, first, images = -math.inf, 0, even
        for k in range(half):
            there = operators.roll(-k, 0)[:half]
            views = found.roll(-k, 1)
            candidate, _ = fit(lines[rows], there, even, self.fixed, views=views)
            likelihood = float((views * expect(lines[rows], there, candidate).log_likelihood).sum())
            if likelihood > likeliest:
                likeliest, first, images = likelihood, k, candidate
        there = operators.roll(-first, 0)[:half]
        images, _ = fit(lines[rows], there, images, self.free, heat=1.5)
        likelihoods = torch.cat([expect(part, there, images).log_likelihood for part in lines.split(8192)])
        responsibilities = balanced(likelihoods.softmax(1), 1.0)
        return torch.cat([responsibilities, torch.zeros_like(likelihoods)], 1).roll(first, 1)


class Gaussian(NamedTuple):
    """N(mean (P,), covariance (P, P)) of the blobs' weights, and the deviation of the readings' noise."""

    mean: Tensor
    covariance: Tensor
    noise: float


class Expectation(NamedTuple):
    """log p(y_n | k), (N, K); the gain of each direction, (K, P, D); A_k Σ, (K, D, P)."""

    log_likelihood: Tensor
    gain: Tensor
    seen: Tensor


def blob_centres(size: int) -> Tensor:
    """(P, 2): the middle, and rings of `POINTS` blobs, in half widths; the second half of a ring opposes the first."""
    rings = max(2, round(REACH / (1.5 * blob_deviation(size))))
    radius = REACH * torch.arange(1, rings + 1, dtype=torch.float64) / rings
    angle = 2 * math.pi * torch.arange(POINTS, dtype=torch.float64) / POINTS
    ring = torch.stack([angle.cos(), angle.sin()], 1)
    return torch.cat([torch.zeros(1, 2, dtype=torch.float64), (radius[:, None, None] * ring).flatten(0, 1)])


def blob_deviation(size: int) -> float:
    """Of a blob of an image `size` pixels wide: 0.08 half widths, at least one pixel's width and a quarter."""
    return max(0.08, 2.5 / size)


def opposite(count: int) -> Tensor:
    """Return the blob onto which half a turn maps each blob, (P,)."""
    rings = 1 + torch.arange(count - 1).view(-1, POINTS).roll(POINTS // 2, 1)
    return torch.cat([torch.zeros(1, dtype=torch.long), rings.flatten()])


def blob_projections(observations: Sequence[Observation], size: int, seed: int) -> Tensor:
    """Return A_k, (K, D, P): the projection of every blob in each direction, averaged over its prior."""
    middles = (torch.arange(size, dtype=torch.float64) + 0.5) / size * 2 - 1
    across, up = torch.meshgrid(middles, -middles, indexing="xy")
    centres = blob_centres(size)
    squares = (across - centres[:, 0, None, None]) ** 2 + (up - centres[:, 1, None, None]) ** 2
    blobs = (-squares / 2 / blob_deviation(size) ** 2).exp()[:, None]
    operators = []
    for observation in observations:
        # The same draws for every blob and direction: what differs between directions is not chance.
        theta = observation.prior.sample(DRAWS, generator_at(seed, 0, "looks at blobs"))
        theta = {name: value.to(blobs).repeat(len(blobs)) for name, value in theta.items()}
        seen = observation.projection(blobs.repeat_interleave(DRAWS, 0), **theta)[:, 0]
        operators.append(seen.view(len(blobs), DRAWS, -1).mean(1).T)
    return torch.stack(operators)


def isotropic(operators: Tensor, lines: Tensor, noise: float, seed: int) -> Gaussian:
    """Return smooth, slightly uneven images that fade from the middle, with the mean reading of the lines."""
    centres = blob_centres(lines.shape[1])
    distance = torch.cdist(centres, centres)
    fading = (-centres.square().sum(1) / 2 / 0.35**2).exp()
    smooth = (-distance.square() / 2 / 0.15**2).exp()
    eye = torch.eye(len(centres), dtype=torch.float64)
    draw = torch.randn(len(centres), dtype=torch.float64, generator=generator_at(seed, 0, "uneven"))
    mean = fading * (1 + 0.02 * torch.linalg.cholesky(smooth + 1e-3 * eye) @ draw)
    scale = float(lines.mean() / (operators @ mean).mean())
    return Gaussian(scale * mean, scale**2 * (0.2 * smooth * torch.outer(fading, fading) + 1e-4 * eye), noise)


def fit(
    lines: Tensor,
    operators: Tensor,
    images: Gaussian,
    iterations: int,
    heat: float = 1.0,
    even: bool = False,
    views: Tensor | None = None,
) -> tuple[Gaussian, Tensor]:
    """Run EM from `images`, with responsibilities `views` (N, K) fixed if given; return the Gaussian and p(k | y)."""
    given = views
    weights = torch.empty(0)
    for _ in range(iterations):
        found = expect(lines, operators, images)
        weights = balanced((found.log_likelihood / heat).softmax(1), 1.0, 10) if given is None else given
        heat = max(1.0, heat * COOLING)
        images = maximise(lines, operators, images, found, weights)
        if even:
            turned = opposite(len(images.mean))
            covariance = images.covariance
            mean = (images.mean + images.mean[turned]) / 2
            images = images._replace(mean=mean, covariance=(covariance + covariance[turned][:, turned]) / 2)
    return images, weights


def expect(lines: Tensor, operators: Tensor, images: Gaussian) -> Expectation:
    """Return the likelihood of each line in each direction, and the gain of E[x | y, k] = μ + G_k (y - A_k μ)."""
    seen = operators @ images.covariance
    eye = torch.eye(lines.shape[1], dtype=torch.float64)
    factor = torch.linalg.cholesky(seen @ operators.mT + images.noise**2 * eye)
    whiten = torch.linalg.solve_triangular(factor, eye.expand_as(factor), upper=False).float()
    expected = (operators @ images.mean).float()
    # In single precision and one direction at a time: the largest array is then (N, D).
    squares = [((lines - m) @ w.mT).square().sum(1) for m, w in zip(expected, whiten, strict=True)]
    volume = factor.diagonal(dim1=1, dim2=2).log().sum(1).float()
    return Expectation(-torch.stack(squares, 1) / 2 - volume, torch.cholesky_solve(seen, factor).mT, seen)


def maximise(lines: Tensor, operators: Tensor, images: Gaussian, found: Expectation, weights: Tensor) -> Gaussian:
    """Return mean and covariance of E[x | y, k] under the weights (N, K), plus the posterior one: Σ - G_k A_k Σ."""
    mass = weights.sum(0).double()
    sums = (weights.T @ lines).double()
    squares = torch.stack([(lines.T @ (w[:, None] * lines)).double() for w in weights.T])
    offset = images.mean - (found.gain @ (operators @ images.mean)[:, :, None])[:, :, 0]
    gained = (found.gain @ sums[:, :, None])[:, :, 0]
    mean = (mass[:, None] * offset + gained).sum(0) / len(lines)
    rest = offset - mean
    spread = found.gain @ squares @ found.gain.mT + mass[:, None, None] * (images.covariance - found.gain @ found.seen)
    cross = gained[:, :, None] * rest[:, None]
    spread = spread + cross + cross.mT + mass[:, None, None] * rest[:, :, None] * rest[:, None]
    covariance = spread.sum(0) / len(lines)
    eye = torch.eye(len(mean), dtype=torch.float64)
    return images._replace(mean=mean, covariance=(covariance + covariance.mT) / 2 + RIDGE * eye)
