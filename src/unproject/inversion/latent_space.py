"""LatentSpace: the latents of a generator, whitened, so that they can be searched.

w = μ + v S Vᵀ, where S Vᵀ are the principal axes of the latents of codes z ~ N(0, 1), each as long as its standard
deviation. Then v ~ (0, 1) along each axis, and E|v|² / r = 1: |v|² / r says how usual a latent is. Of a generator
without mapping network w is the code, and v a rotation of it. Entries of w that are white noise already are left as
they are (`Generator.white`), behind the others.

References:
    Abdal et al. 2019, Image2StyleGAN (latents behind the mapping network are easier to fit than codes); Zhu et al.
    2020, Improved StyleGAN embedding (whitened latents with a Gaussian prior).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .._random import generator_at
from ..networks import Generator

CODES, AT_ONCE = 4096, 128
MIN_RELATIVE_LENGTH = 1e-3
"""Axes shorter than this share of the longest are left out: nothing is known of them."""


@dataclass(frozen=True)
class LatentSpace:
    """w = μ + v B.

    Attributes:
        mean: μ, (D,).
        axes: B, (r, D), orthogonal; row i is the i-th axis.
        white: number of entries behind them.

    Examples:
        >>> import torch, unproject as up
        >>> generator = up.networks.LowRankGenerator(size=16, code_size=8, channels=8, rank=4)
        >>> space = LatentSpace.of(generator)
        >>> w = generator.map_code(torch.randn(2, 8))
        >>> bool(torch.allclose(space.latents(space.whitened(w)), w, atol=0.01))
        True
    """

    mean: Tensor
    axes: Tensor
    white: int = 0

    @classmethod
    @torch.no_grad()
    def of(cls, generator: Generator, seed: int = 0, count: int = CODES) -> LatentSpace:
        """Return the whitened latents of a generator, from those of `count` codes."""
        rng, device = generator_at(seed, 0, "latent space"), next(generator.parameters()).device
        codes = generator.draw(count, rng).to(device)
        parts = (generator.map_code(some).flatten(1) for some in codes.split(AT_ONCE))
        latents = torch.cat([part[:, : part.shape[1] - generator.white].double() for part in parts])
        mean = latents.mean(0)
        _, length, axes = torch.linalg.svd(latents - mean, full_matrices=False)
        kept = length > MIN_RELATIVE_LENGTH * length[0]
        deviation = length[kept, None] / (len(latents) - 1) ** 0.5
        return cls(mean.float(), (deviation * axes[kept]).float(), generator.white)

    def whitened(self, latents: Tensor) -> Tensor:
        """Return v (B, r + white) of latents (B, D + white)."""
        w, noise = latents[:, : len(self.mean)], latents[:, len(self.mean) :]
        return torch.cat([(w - self.mean) @ (self.axes / self.axes.square().sum(1, keepdim=True)).T, noise], 1)

    def latents(self, v: Tensor) -> Tensor:
        """Return w (B, D + white) of v (B, r + white)."""
        return torch.cat([self.mean + v[:, : len(self.axes)] @ self.axes, v[:, len(self.axes) :]], 1)

    def unusual(self, v: Tensor) -> Tensor:
        """Return |v|² / r (B,), the mean square of the entries along axes, and that of the noise added to it."""
        square = v.square()
        usual = square[:, : len(self.axes)].mean(1)
        return usual + square[:, len(self.axes) :].mean(1) if self.white else usual
