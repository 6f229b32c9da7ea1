"""Novelty: whether a picture is of the kind that a run was trained on, or of something else.

How far the nearest projection is does not tell: a plump bird is nearer to some chair than most chairs are, and thin
objects are far from everything. Two numbers say more, each compared with those of pictures that were held out:

- d² = Σ_i ((y - μ) · e_i)² / λ_i, by the first principal components of training pictures: proportions that none has;
- the logit of a small network that tells training pictures from warped ones: outlines that none has, since warping
  spoils what objects have in common, straight legs or symmetry, and leaves their proportions.

The p-value is twice the smaller share of held-out pictures that are at least as strange. Among the strangest fifth, ten
at most, it falls about exponentially, by their median excess: of 20 held-out pictures a share could never be below
0.05, and one odd picture among them would excuse all others. Several pictures of one object have the harmonic mean of
theirs. Pictures are held out, not objects: where a collection has several of each object, p holds for new pictures of
the same objects, and is too small for new ones. Of new chairs 10 % have p < 0.03, 13 % p < 0.05.

References:
    Lee et al. 2018, A simple unified framework for detecting out-of-distribution samples (Mahalanobis distance); Tack
    et al. 2020, CSI: novelty detection via contrasting with transformed training data; Wilson 2019, The harmonic mean
    p-value for combining dependent tests; Pickands 1975 (exponential tails).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .._random import derived_seed, generator_at, seeded

COMPONENTS, STEPS, BATCH, AT_ONCE = 32, 300, 64, 512
MAX_PIXELS, MAX_EXACT_SIDE = 2**26, 1024
"""Pixels of all pictures whose components are found; the side of a matrix of them up to which these are exact."""
SMALLEST = 8
"""Pixels a side of the pictures that the network takes, at least."""
BENT, KNOTS = 0.35, 4
"""Deviation of a warp in half widths of the picture, and knots a side between which it is smooth."""
DOUBTFUL = 0.03
"""The p-value below which a picture counts as of another kind."""
TAIL = (5, 0.2, 10)
"""Least number, share and largest number of the strangest held-out pictures, among which p falls exponentially."""

Prepare = Callable[[Tensor], Tensor]


@dataclass(frozen=True, eq=False)
class Novelty:
    """Compares pictures with those that a run was trained on; `fitted` makes it.

    Attributes:
        mean, axes: μ (D,) and e_i / √λ_i (r, D).
        network: logits of pictures, the larger the more like training pictures; None for lines, and for pictures of
            less than 8 pixels a side, which three halvings leave nothing of.
        held_out: (M, 1) or (M, 2), both numbers of held-out pictures.

    Examples:
        >>> import torch, unproject as up
        >>> views = up.projections.azimuth_bins(8, up.Silhouette(size=16))
        >>> chairs = up.data.observe(up.data.chairs(60, 16), views, each=4).floats()
        >>> novelty = Novelty.fitted(chairs[:160], chairs[160:], steps=20, masks=True)
        >>> p = novelty.p_values(torch.cat([chairs[:1], 1 - chairs[:1]]))
        >>> bool(p[0] > 0.05), bool(p[1] < 0.05)
        (True, True)
    """

    mean: Tensor
    axes: Tensor
    network: nn.Module | None
    held_out: Tensor

    @classmethod
    def fitted(
        cls,
        pictures: Tensor,
        held_out: Tensor,
        prepare: Prepare = lambda y: y,
        steps: int = STEPS,
        seed: int = 0,
        *,
        masks: bool,
    ) -> Novelty:
        """Return what compares with training pictures (N, ...), and knows held-out ones (M, ...).

        Args:
            prepare: what the projection does to its pictures (`Projection.prepare`), done to warped ones.
            steps: of the network, which pictures (C, H, W) of 8 pixels a side or more have.
            masks: whether pictures are masks, which stay so when they are warped.
        """
        rng = generator_at(seed, 0, "novelty")
        most = max(MAX_PIXELS // pictures[0].numel(), 2 * COMPONENTS)
        some = pictures[torch.randperm(len(pictures), generator=rng)[: min(most, 4096)]].flatten(1)
        mean = some.mean(0)
        length, axes = _principal(some - mean, derived_seed(seed, 0, "novelty"))
        count = min(COMPONENTS, int((length > 1e-3 * length[0]).sum()))
        axes = axes[:count] / (length[:count, None] / len(some) ** 0.5)
        halves = pictures.dim() == 4 and min(pictures.shape[2:]) >= SMALLEST
        network = _trained(pictures, prepare, steps, seed, masks) if halves else None
        found = cls(mean, axes, network, torch.empty(0))
        return cls(mean, axes, network, found.strangeness(held_out))

    @torch.no_grad()
    def strangeness(self, pictures: Tensor) -> Tensor:
        """Return both numbers, larger for stranger pictures, (N, 1) or (N, 2)."""
        distance = ((pictures.flatten(1) - self.mean) @ self.axes.T).square().sum(1)
        if self.network is None:
            return distance[:, None]
        logits = torch.cat([self.network(part)[:, 0] for part in pictures.split(AT_ONCE)])
        return torch.stack([distance, -logits], 1)

    def p_values(self, pictures: Tensor) -> Tensor:
        """Return (N,): how likely a picture like those held out would be so strange; small for other kinds."""
        found, count = self.strangeness(pictures), len(self.held_out)
        shares = ((self.held_out[None] >= found[:, None]).sum(1) + 1) / (count + 1)
        least, share, most = TAIL
        tail = min(max(least, round(share * count)), most)
        if count > tail:
            strangest = self.held_out.sort(0, descending=True).values[: tail + 1]
            first, excess = strangest[-1], (strangest[:-1] - strangest[-1]).median(0).values.clamp_min(1e-12)
            by = (found - first).clamp_min(0) / (excess / math.log(2))
            beyond = (tail + 1) / (count + 1) * (1 + by / tail) ** -tail  # exp(-by), as uncertain as so few make it
            shares = torch.where(found > first, beyond, shares)
        return (shares.amin(1) * shares.shape[1]).clamp_max(1)


def combined(p: Tensor) -> float:
    """Return the p-value of an object by those (K,) of its pictures: K / Σ 1/p_k, their harmonic mean.

    Examples:
        >>> import torch
        >>> round(combined(torch.tensor([0.02, 0.5, 0.5])), 3)
        0.056
    """
    return len(p) / p.reciprocal().sum().item()


def _principal(x: Tensor, seed: int) -> tuple[Tensor, Tensor]:
    """Return the largest singular values of x (N, D), in order, and their axes (r, D): all, or of many some 48."""
    if min(x.shape) <= MAX_EXACT_SIDE:
        _, length, axes = torch.linalg.svd(x, full_matrices=False)
        return length, axes
    with seeded(seed, "components"):
        _, length, axes = torch.svd_lowrank(x, COMPONENTS + 16, niter=4)
    return length, axes.T


def network_for(shape: tuple[int, ...]) -> nn.Module:
    """Return the network for pictures of this shape, (C, H, W)."""
    layers: list[nn.Module] = []
    for before, after in ((shape[0], 32), (32, 64), (64, 128)):
        layers += [nn.Conv2d(before, after, 4, 2, 1), nn.BatchNorm2d(after), nn.LeakyReLU(0.2)]
    features = 128 * (shape[1] // 8) * (shape[2] // 8)
    return nn.Sequential(*layers, nn.Flatten(), nn.Dropout(0.3), nn.Linear(features, 1))


def _trained(pictures: Tensor, prepare: Prepare, steps: int, seed: int, masks: bool) -> nn.Module:
    """Return a network that tells pictures from warped ones."""
    with seeded(derived_seed(seed, 0, "novelty"), "weights"):
        network = network_for(tuple(pictures.shape[1:]))
        adam = torch.optim.Adam(network.parameters(), lr=1e-3)
        for step in range(steps):
            rng = generator_at(seed, step, "warped")
            real = pictures[torch.randint(len(pictures), (BATCH,), generator=rng)]
            loss = F.softplus(-network(real)).mean() + F.softplus(network(warped(real, rng, masks, prepare))).mean()
            adam.zero_grad()
            loss.backward()
            adam.step()
    return network.eval()


def warped(pictures: Tensor, rng: torch.Generator, masks: bool, prepare: Prepare = lambda y: y) -> Tensor:
    """Return pictures (B, C, H, W) warped smoothly at random; masks stay masks, or blur would give them away.

    Outside of masks there is nothing; photographs are reflected, or black rims would give them away.
    """
    count, size = len(pictures), [2 * side for side in pictures.shape[2:]]
    fine = F.interpolate(pictures, size=size, mode="bilinear", align_corners=False)
    lines = [torch.linspace(1 / side - 1, 1 - 1 / side, side) for side in size]
    place = torch.stack(torch.meshgrid(*lines, indexing="ij")[::-1], -1)
    bend = BENT * torch.randn(count, 2, KNOTS, KNOTS, generator=rng)
    bend = F.interpolate(bend, size=size, mode="bicubic", align_corners=False).permute(0, 2, 3, 1)
    outside = "zeros" if masks else "reflection"
    bent = F.grid_sample(fine, (place + bend).to(fine), padding_mode=outside, align_corners=False)
    framed = prepare((bent > 0.5).to(bent) if masks else bent)
    return framed if framed.shape == pictures.shape else F.avg_pool2d(framed, 2)
