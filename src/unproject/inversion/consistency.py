"""Data consistency: linear readings are kept, and the sample fills in what they leave open.

A generator hardly ever makes the very image behind line integrals y = A x, yet those are what is known of it best. With
g what was found among its samples,

    x = argmin |A x - y|² + μ |x - g|²    over all x of the generator's range.

μ, the variance of the noise over that of x - g, is the one that makes the misfit r = y - A g most likely, which is
N(0, s² (A Aᵀ + μ I)) with s unknown: with λ_i, u_i the M eigenvalues and eigenvectors of A Aᵀ,

    log p(r) = -M/2 log(mean_i (u_i · r)² / (λ_i + μ)) - ½ Σ_i log(λ_i + μ) + const.

Nothing is to be chosen: readings without noise are met to the last digit, and noisy ones are believed as far as the
misfit looks more like another image than like noise.

References:
    Beck and Teboulle 2009, A fast iterative shrinkage-thresholding algorithm; MacKay 1992, Bayesian interpolation (the
    evidence for a ridge).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor

MAX_ENTRIES = 2**23
"""Entries of A at most: half a minute of one thread."""
AT_ONCE, STEPS, SETTLED = 256, 1000, 1e-7
"""Rows of A made at once; steps of the descent at most, and the change of a value at which it has ended."""
NOISE = tuple(10.0 ** (half / 2) for half in range(-12, 7))
"""Values of μ that are compared, in units of the mean λ_i."""
EQUAL = 1e-3
"""Eigenvalues that differ by less, as a share of the largest, are equal."""
EXACT = 1e-7
"""Singular values of A that are no rounding, as a share of the largest."""


@dataclass(frozen=True, eq=False)
class Readings:
    """Linear readings y = A x: A (M, P), of 64 bits.

    Examples:
        >>> import torch, unproject as up
        >>> digit, angle, lines = up.data.digits(16)[3], torch.tensor([0.0, 1.0, 2.0]), up.LineIntegral()
        >>> readings = Readings.of(lambda x, which: lines(x, angle=angle[which]), 3, digit.shape)
        >>> y = readings.matrix @ digit.flatten().double()
        >>> x = readings.completed(torch.full((1, 256), 0.3).double(), y, (0.0, 1.0))
        >>> bool((readings.matrix @ x[0] - y).abs().max() < 1e-4)
        True
    """

    matrix: Tensor

    @classmethod
    def of(cls, project: Callable[[Tensor, Tensor], Tensor], count: int, shape: torch.Size) -> Readings:
        """Return the readings of `count` pictures of one sample; row (m, j) is the gradient of pixel j of picture m.

        Args:
            project: samples (B, ...) and the picture (B,) that is taken of each → pictures (B, ...), linear.
            shape: of a sample.
        """
        one = project(torch.zeros(1, *shape, dtype=torch.float64), torch.zeros(1, dtype=torch.long))
        picture, pixel = torch.arange(count * one.numel()).div(one.numel(), rounding_mode="floor"), one.numel()
        parts = []
        for rows in torch.arange(len(picture)).split(AT_ONCE):
            x = torch.zeros(len(rows), *shape, dtype=torch.float64, requires_grad=True)
            with torch.enable_grad():
                seen = project(x, picture[rows]).flatten(1)
                (gradient,) = torch.autograd.grad(seen.gather(1, (rows % pixel)[:, None]).sum(), x)
            parts.append(gradient.flatten(1))
        return cls(torch.cat(parts))

    @cached_property
    def spectrum(self) -> tuple[Tensor, Tensor]:
        """λ (R,) and u (M, R), its columns, with R the lesser of M and P: the other λ are 0."""
        if len(self.matrix) <= self.matrix.shape[1]:
            values, vectors = torch.linalg.eigh(self.matrix @ self.matrix.T)
            return values.clamp_min(0), vectors
        values, axes = torch.linalg.eigh(self.matrix.T @ self.matrix)
        values = values.clamp_min(0)
        return values, self.matrix @ axes / values.sqrt().clamp_min(EXACT * values.max().sqrt())

    @property
    def tell_noise(self) -> bool:
        """Whether noise of readings differs from a misfit of samples: not if all λ are equal, as of means of pixels."""
        values = self.spectrum[0]
        return bool(values.max() - values.min() > EQUAL * values.max())

    def noise(self, misfit: Tensor) -> float:
        """Return μ, the most likely for a misfit r (M,)."""
        values, vectors = self.spectrum
        square = (vectors.T @ misfit).square()
        if others := len(misfit) - len(values):  # with λ = 0, of which the mean alone is needed
            rest = (misfit.square().sum() - square.sum()).clamp_min(0) / others
            values, square = torch.cat([values, values.new_zeros(others)]), torch.cat([square, rest.expand(others)])

        def evidence(mu: float) -> float:
            total = values + mu
            return (-len(misfit) / 2 * (square / total).mean().log() - total.log().sum() / 2).item()

        return max((values.mean().item() * share for share in NOISE), key=evidence)

    def completed(self, x: Tensor, y: Tensor, bounds: tuple[float, float]) -> Tensor:
        """Return x (S, P) as near as can be to what it was, and in agreement with y (M,), within bounds."""
        mu = torch.tensor([[self.noise(y - self.matrix @ g)] for g in x], dtype=x.dtype)
        step = 1 / (self.spectrum[0].max() + mu)
        given, ahead, pace = x, x.clamp(*bounds), 1.0
        x = ahead
        for _ in range(STEPS):
            slope = (ahead @ self.matrix.T - y) @ self.matrix + mu * (ahead - given)
            new = (ahead - step * slope).clamp(*bounds)
            if (new - x).abs().max() < SETTLED:
                return new
            following = (1 + (1 + 4 * pace**2) ** 0.5) / 2
            ahead, x, pace = new + (pace - 1) / following * (new - x), new, following
        return x
