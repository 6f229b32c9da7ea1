"""Fit: what was found behind pictures: several samples that explain them, and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


@dataclass(frozen=True)
class Fit:
    """S explanations of M pictures of one object, the best first.

    Attributes:
        x: (S, ...) samples.
        latent: (S, r), whitened (`LatentSpace`).
        distance: (S, M), the mean squared difference of each picture from the sample's projection, in units of the
            variance of projections of other samples: about 1 for an unrelated picture. Measured before samples are
            completed (`consistent`): whether the generator can make such things.
        weight: (S,), how well each explains the pictures compared with the others, before the best is tuned to them;
            they sum to 1.
        theta: latents of the views by name, (S, M), radians.
        posterior: (M, K), the probability of each bin of views.
        projections: (S, M, ...), of each explanation in the views that were found for it.
        consistent: whether samples were made to agree with the pictures (`consistency`).

    Examples:
        >>> import torch, unproject as up
        >>> from unproject.inversion import Fitter, Search, Viewing
        >>> generator = up.networks.LowRankGenerator(size=16, code_size=8, channels=8, rank=4).eval()
        >>> viewing = Viewing.of(up.projections.azimuth_bins(4, up.Silhouette(size=16)))
        >>> fitter = Fitter(generator, viewing, Search(candidates=8, starts=2, steps=2))
        >>> found = fitter.fit(torch.rand(1, 1, 16, 16))
        >>> found.x.shape, found.posterior.shape
        (torch.Size([2, 16, 16, 16]), torch.Size([1, 4]))
        >>> found.projections.shape
        torch.Size([2, 1, 1, 16, 16])
    """

    x: Tensor
    latent: Tensor
    distance: Tensor
    weight: Tensor
    theta: dict[str, Tensor]
    posterior: Tensor
    projections: Tensor
    consistent: bool = False

    @property
    def projected(self) -> Tensor:
        """Return the projections of the best, (M, ...)."""
        return self.projections[0]

    @property
    def error(self) -> float:
        """The mean distance of the pictures from the best sample's projections."""
        return self.distance[0].mean().item()

    @property
    def mean(self) -> Tensor:
        """The mean of the explanations by their weights."""
        return torch.einsum("s,s...->...", self.weight.to(self.x), self.x)

    @property
    def deviation(self) -> Tensor:
        """Where they differ: the standard deviation of the explanations by their weights."""
        off = (self.x - self.mean).square()
        return torch.einsum("s,s...->...", self.weight.to(self.x), off).sqrt()
