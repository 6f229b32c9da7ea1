"""A first guess at the directions of line integrals: the Gaussian of images that explains all lines best.

A generator and a view predictor that know nothing agree on whatever they happen to agree on first: images turned
against one another, each of which explains its own lines. What all lines together say to second order is enough to
turn most of them the same way, and needs no network.
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
from .assignment import balanced

POINTS = 20  # blobs on a ring
REACH = 0.72  # radius of the outermost ring, in half widths of the image
LOOKS = 8  # draws of each direction that its matrix is the mean of
COOLING = 0.97  # of the temperature, an iteration
RIDGE = 1e-7  # on the diagonal of Σ


@dataclass(frozen=True)
class GaussianStart:
    """x ~ N(μ, Σ), y = A_k x + ε, ε ~ N(0, s²), directions k equally frequent: p(k | y) by annealed EM.

    x are the weights of blobs on rings and A_k their line integrals in direction k, so that no direction is special.
    The directions lie in order around a whole turn, and the lines were measured in some half of it, nobody knows which:

    1. μ and Σ are kept the same under half a turn of the image. Then no line differs from itself read backwards, any
       rotation or reflection of a solution is one too, and annealing finds the directions up to half a turn.
    2. Given those, the half is the one that makes lines and directions together likeliest; a few more iterations,
       free of the symmetry, follow. The half may be wrong by one direction, which `Predicted(window=...)` mends.

    Args:
        lines: that the Gaussian is fitted to; the others are told their probabilities.
        annealed, fixed, free: iterations of stage 1, of stage 2 for every half, and after it.
        heat: the probabilities of stage 1 are drawn to equal ones by the power 1 / heat at first.
        noise: s, in deviations of the readings.

    References:
        EM for mixtures of factor analysers (Ghahramani and Hinton 1996), with one distribution behind all of them;
        annealing of its first step (Ueda and Nakano 1998).
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
        """p(k | y), (N, ways), of lines (N, 1, D) for an even number of directions around a whole turn.

        Raises:
            UserError: if these are not line integrals, or the number of directions is odd.
        """
        if items.dim() != 3 or items.shape[1] != 1 or not observations[0].projection.linear or len(observations) % 2:
            raise UserError("GaussianStart: takes line integrals in directions around a whole turn; leave it out here")
        lines = items[:, 0].float()
        rows = torch.randperm(len(lines), generator=generator_at(seed, 0, "lines"))[: self.lines]
        half = len(observations) // 2
        looks = blob_looks(observations, lines.shape[1], seed)
        start = isotropic(looks, lines, self.noise * float(lines.std()), seed)

        even, told = fit(lines[rows], looks[:half], start, self.annealed, heat=self.heat, even=True)
        likeliest, first, images = -math.inf, 0, even
        for k in range(half):
            there = looks.roll(-k, 0)[:half]
            ways = told.roll(-k, 1)
            candidate, _ = fit(lines[rows], there, even, self.fixed, ways=ways)
            likelihood = float((ways * expect(lines[rows], there, candidate).log_likelihood).sum())
            if likelihood > likeliest:
                likeliest, first, images = likelihood, k, candidate
        there = looks.roll(-first, 0)[:half]
        images, _ = fit(lines[rows], there, images, self.free, heat=1.5)
        found = torch.cat([expect(part, there, images).log_likelihood for part in lines.split(8192)])
        found = torch.cat([balanced(found.softmax(1), 1.0), torch.zeros_like(found)], 1)
        return found.roll(first, 1)


class Gaussian(NamedTuple):
    """N(mean (P,), covariance (P, P)) of the blobs' weights, and the variance of the readings' noise."""

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
    """Where each of the blobs comes to lie after half a turn, (P,)."""
    rings = 1 + torch.arange(count - 1).view(-1, POINTS).roll(POINTS // 2, 1)
    return torch.cat([torch.zeros(1, dtype=torch.long), rings.flatten()])


def blob_looks(observations: Sequence[Observation], size: int, seed: int) -> Tensor:
    """A_k, (K, D, P): what each direction sees of every blob, the mean over its prior."""
    middles = (torch.arange(size, dtype=torch.float64) + 0.5) / size * 2 - 1
    across, up = torch.meshgrid(middles, -middles, indexing="xy")
    centres = blob_centres(size)
    squares = (across - centres[:, 0, None, None]) ** 2 + (up - centres[:, 1, None, None]) ** 2
    blobs = (-squares / 2 / blob_deviation(size) ** 2).exp()[:, None]
    looks = []
    for observation in observations:
        # The same draws for every blob and direction: what differs between directions is not chance.
        theta = observation.prior.sample(LOOKS, generator_at(seed, 0, "looks at blobs"))
        theta = {name: value.to(blobs).repeat(len(blobs)) for name, value in theta.items()}
        seen = observation.projection(blobs.repeat_interleave(LOOKS, 0), **theta)[:, 0]
        looks.append(seen.view(len(blobs), LOOKS, -1).mean(1).T)
    return torch.stack(looks)


def isotropic(looks: Tensor, lines: Tensor, noise: float, seed: int) -> Gaussian:
    """Images that fade from the middle, smooth, with the mean reading of the lines; a little uneven, by `seed`."""
    centres = blob_centres(lines.shape[1])
    distance = torch.cdist(centres, centres)
    fading = (-centres.square().sum(1) / 2 / 0.35**2).exp()
    smooth = (-distance.square() / 2 / 0.15**2).exp()
    eye = torch.eye(len(centres), dtype=torch.float64)
    draw = torch.randn(len(centres), dtype=torch.float64, generator=generator_at(seed, 0, "uneven"))
    mean = fading * (1 + 0.02 * torch.linalg.cholesky(smooth + 1e-3 * eye) @ draw)
    scale = float(lines.mean() / (looks @ mean).mean())
    return Gaussian(scale * mean, scale**2 * (0.2 * smooth * torch.outer(fading, fading) + 1e-4 * eye), noise)


def fit(
    lines: Tensor,
    looks: Tensor,
    images: Gaussian,
    iterations: int,
    heat: float = 1.0,
    even: bool = False,
    ways: Tensor | None = None,
) -> tuple[Gaussian, Tensor]:
    """EM from `images`; with `ways` (N, K) given they stay. Returns the Gaussian and p(k | y) at the last step."""
    given = ways
    weights = torch.empty(0)
    for _ in range(iterations):
        found = expect(lines, looks, images)
        weights = balanced((found.log_likelihood / heat).softmax(1), 1.0, 10) if given is None else given
        heat = max(1.0, heat * COOLING)
        images = maximise(lines, looks, images, found, weights)
        if even:
            turned = opposite(len(images.mean))
            covariance = images.covariance
            mean = (images.mean + images.mean[turned]) / 2
            images = images._replace(mean=mean, covariance=(covariance + covariance[turned][:, turned]) / 2)
    return images, weights


def expect(lines: Tensor, looks: Tensor, images: Gaussian) -> Expectation:
    """How likely each direction makes each line, and what that says of the image: E[x | y, k] = μ + G_k (y - A_k μ)."""
    seen = looks @ images.covariance
    eye = torch.eye(lines.shape[1], dtype=torch.float64)
    factor = torch.linalg.cholesky(seen @ looks.mT + images.noise**2 * eye)
    whiten = torch.linalg.solve_triangular(factor, eye.expand_as(factor), upper=False).float()
    expected = (looks @ images.mean).float()
    # In single precision and one direction at a time: the largest array is then (N, D).
    squares = [((lines - m) @ w.mT).square().sum(1) for m, w in zip(expected, whiten, strict=True)]
    volume = factor.diagonal(dim1=1, dim2=2).log().sum(1).float()
    return Expectation(-torch.stack(squares, 1) / 2 - volume, torch.cholesky_solve(seen, factor).mT, seen)


def maximise(lines: Tensor, looks: Tensor, images: Gaussian, found: Expectation, weights: Tensor) -> Gaussian:
    """Mean and covariance of E[x | y, k] under the weights (N, K), plus what a line leaves unsaid: Σ - G_k A_k Σ."""
    mass = weights.sum(0).double()
    sums = (weights.T @ lines).double()
    squares = torch.stack([(lines.T @ (w[:, None] * lines)).double() for w in weights.T])
    offset = images.mean - (found.gain @ (looks @ images.mean)[:, :, None])[:, :, 0]
    told = (found.gain @ sums[:, :, None])[:, :, 0]
    mean = (mass[:, None] * offset + told).sum(0) / len(lines)
    rest = offset - mean
    spread = found.gain @ squares @ found.gain.mT + mass[:, None, None] * (images.covariance - found.gain @ found.seen)
    cross = told[:, :, None] * rest[:, None]
    spread = spread + cross + cross.mT + mass[:, None, None] * rest[:, :, None] * rest[:, None]
    covariance = spread.sum(0) / len(lines)
    eye = torch.eye(len(mean), dtype=torch.float64)
    return images._replace(mean=mean, covariance=(covariance + covariance.mT) / 2 + RIDGE * eye)
