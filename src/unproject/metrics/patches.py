"""Texture distances of two sets of images, without learned weights: patches and filter responses.

*Laplacian pyramid* (`ops.pyramids`) of an image, down to a shorter side of 16.

*Patch distance*, Karras et al.'s sliced Wasserstein distance: patches p of 7×7 of each band, K random unit vectors w,

    SWD_l = 1/K Σ_w W1({w·p / s}, {w·q / s}),     W1 = ∫₀¹ |F⁻¹(t) - G⁻¹(t)| dt

for patches p of the generated and q of the true set, at the same random places in every image. Karras et al. normalise
each set by its own mean and deviation of a channel, which hides wrong colours and wrong contrast. Here both sets are
divided by the *truth's* deviation s of the channel in that band (1/255 or more) and nothing is subtracted: the unit is
the truth's deviation, for every band and map. Sets of different sizes are compared exactly, quantile by quantile.

*Texture features* of an image, in the unit of its values: per channel the mean and the deviation, the deviations of the
differences of any two channels (together: the covariance); and at each octave g_l, per channel and direction u of four
(0°, 45°, 90°, 135°), with r = ∂_u G * g_l, s = ∂²_u G * g_l, G a Gaussian of one texel of that octave,

    rms of max(r, 0), max(-r, 0), max(s, 0), max(-s, 0);   mean of the local energy √(r² + s²)

Features are standardised by the truth's mean and deviation (1/255 or more), and each group, colour or an octave, has
the same weight: a·b / d is the mean over groups of the mean product. *Kernel distance*: `feature_sets` on these. For
two samples of N of one distribution it is about ±2/N, and -1/N on average, as the truth is standardised by itself.

References:
    Karras et al., Progressive growing of GANs, ICLR 2018 (sliced Wasserstein distance on a Laplacian pyramid).
    Burt and Adelson, The Laplacian pyramid as a compact image code, 1983.
    Portilla and Simoncelli, A parametric texture model based on joint statistics of wavelet coefficients, 2000.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError
from ..ops.pyramids import filter_matrix, gaussian_pyramid, laplacian_pyramid
from .distances import check_set
from .feature_sets import kernel_distance

SMALLEST = 16
SIDE = 7
PROJECTIONS = 256
FEWEST, WANTED = 16, 1 << 12
"""Patches of an image at a level: WANTED over the number of images in the larger set, but FEWEST or more."""

QUANTUM = 1 / 255
CHUNK = 32


def chunks(x: Tensor) -> Iterator[Tensor]:
    """Split x into parts that fit a processor's cache, on the CPU and in single precision."""
    return (part.detach().cpu().float() for part in x.split(CHUNK))


def check_pair(generated: Tensor, truth: Tensor, least: int = 2, what: str = "images") -> None:
    """Check that two sets (N, C, H, W) can be compared.

    Raises:
        UserError: for fewer than `least` items, different sizes, a side below 16, or NaN.
    """
    sizes = f"{tuple(generated.shape)} and {tuple(truth.shape)}"
    if generated.dim() != 4 or generated.shape[1:] != truth.shape[1:] or min(len(generated), len(truth)) < least:
        raise UserError(f"{what}: give at least {least} of one size a set, (N, C, H, W), not {sizes}")
    if min(truth.shape[-2:]) < SMALLEST:
        raise UserError(f"{what}: give at least {SMALLEST}x{SMALLEST} texels, not {sizes}")
    for items, whose in ((generated, "generated"), (truth, "true")):
        for part in items.split(CHUNK):
            check_set(part, f"of {whose} {what}")


@dataclass(frozen=True)
class PatchDistance:
    """Sliced Wasserstein distances by level: the level's shorter side in texels → distance, finest first.

    Attributes:
        levels: in deviations of the truth.
        patches: of an image at a level, less where it has fewer places.
    """

    levels: dict[int, float]
    patches: int

    @property
    def mean(self) -> float:
        return sum(self.levels.values()) / len(self.levels)


@dataclass(frozen=True)
class _Probe:
    """The patches and projections of a level: P places (row, column) and K directions, weights (K, C·49)."""

    rows: Tensor
    columns: Tensor
    weights: Tensor

    def __call__(self, band: Tensor) -> Tensor:
        """Project the patches of (n, C, H, W) to (K, n·P)."""
        patches = band.unfold(2, SIDE, 1).unfold(3, SIDE, 1)[:, :, self.rows, self.columns]
        return self.weights @ patches.transpose(1, 2).flatten(2).flatten(0, 1).T


@torch.no_grad()
def patch_distance(
    generated: Tensor, truth: Tensor, *, seed: int = 0, projections: int = PROJECTIONS, patches: int | None = None
) -> PatchDistance:
    """Compute the sliced Wasserstein distance of 7×7 patches, level by level.

    It is 0 for a set against itself, in any order. For two finite samples of one distribution it is positive, the
    larger the smaller they are: compare with a baseline of the same size.

    Args:
        generated: (G, C, H, W).
        truth: (T, C, H, W), whose deviations are the unit.
        seed: of the places and the directions.
        projections: directions a level.
        patches: of an image at a level (default: 4096 in the larger set, but 16 or more).

    Raises:
        UserError: for sets of fewer than two images, different sizes, sides below 16, or NaN.

    Examples:
        >>> import torch, unproject as up
        >>> images = torch.rand(4, 1, 32, 32, generator=torch.Generator().manual_seed(0))
        >>> up.metrics.patch_distance(images, images.flip(0), patches=16).levels
        {32: 0.0, 16: 0.0}
    """
    check_pair(generated, truth)
    wanted = patches or max(FEWEST, math.ceil(WANTED / max(len(generated), len(truth))))
    levels = _deviations(truth)
    probes = [
        _probe(size, deviation, wanted, projections, generator_at(seed, level, "patches"))
        for level, (size, deviation) in enumerate(levels)
    ]
    distances = map(_sliced, _projected(generated, probes), _projected(truth, probes))
    return PatchDistance(dict(zip((min(size[1:]) for size, _ in levels), distances)), wanted)


def _deviations(truth: Tensor) -> list[tuple[torch.Size, Tensor]]:
    """Return the size (C, H, W) of each band and the deviation (C,) of each channel in it, over texels and images."""
    sizes, sums = [], []
    for part in chunks(truth):
        bands = [band.double() for band in laplacian_pyramid(part, SMALLEST)]
        sizes = [band.shape[1:] for band in bands]
        sums.append([torch.stack([band.sum((0, 2, 3)), band.square().sum((0, 2, 3))]) for band in bands])
    means = [torch.stack(level).sum(0) / (len(truth) * size[1:].numel()) for size, level in zip(sizes, zip(*sums))]
    return [(size, (square - mean**2).clamp_min(0).sqrt()) for size, (mean, square) in zip(sizes, means)]


def _probe(size: torch.Size, deviation: Tensor, patches: int, projections: int, rng: torch.Generator) -> _Probe:
    channels, height, width = size
    across = width - SIDE + 1
    places = torch.randperm((height - SIDE + 1) * across, generator=rng)[:patches]
    weights = torch.randn(projections, channels, SIDE * SIDE, generator=rng)
    weights = weights / weights.flatten(1).norm(dim=1)[:, None, None]
    weights = weights / deviation.float().clamp_min(QUANTUM)[:, None]
    return _Probe(places // across, places % across, weights.flatten(1))


def _projected(images: Tensor, probes: Sequence[_Probe]) -> list[Tensor]:
    """Return the projected patches (K, N·P) of each level."""
    parts = [[probe(band) for probe, band in zip(probes, laplacian_pyramid(part, SMALLEST))] for part in chunks(images)]
    return [torch.cat(level, 1) for level in zip(*parts)]


def _sliced(x: Tensor, y: Tensor) -> float:
    rows = 32  # at a time
    return torch.cat([wasserstein(a, b) for a, b in zip(x.split(rows), y.split(rows))]).mean().item()


def wasserstein(x: Tensor, y: Tensor) -> Tensor:
    """Compute W1 = ∫₀¹ |F⁻¹ - G⁻¹| (K,) of each row of x (K, m) and y (K, n), exactly.

    The quantile functions are constant between the multiples of 1/m and of 1/n.
    """
    m, n = x.shape[1], y.shape[1]
    a, b = (torch.from_numpy(np.sort(value.numpy(), axis=1)) for value in (x, y))  # four times as fast as torch's
    if m == n:
        return (a - b).abs().mean(1)
    steps = torch.cat([torch.arange(m + 1) * n, torch.arange(n + 1) * m]).unique()  # in 1/mn
    widths = steps.diff().to(x.dtype) / (m * n)
    return (a[:, steps[:-1] // n] - b[:, steps[:-1] // m]).abs() @ widths


@torch.no_grad()
def kernel_patches(generated: Tensor, truth: Tensor) -> float:
    """Compute the unbiased cubic-kernel distance of the texture features of two sets of images (N, C, H, W).

    About 0 for two samples of one distribution, possibly negative. It is deterministic.

    Raises:
        UserError: for sets of fewer than two images, different sizes, sides below 16, or NaN.
    """
    check_pair(generated, truth)
    return kernel_distance(*standardised(texture_features(generated), texture_features(truth)))


@torch.no_grad()
def texture_features(images: Tensor) -> list[Tensor]:
    """Return features of (N, C, H, W) in groups: colour (N, 2C + C(C-1)/2), then (N, 20C) an octave, finest first."""
    parts = [[_colours(part), *map(_octave, gaussian_pyramid(part, SMALLEST))] for part in chunks(images)]
    return [torch.cat(group) for group in zip(*parts)]


def _colours(x: Tensor) -> Tensor:
    mean = x.mean((2, 3), keepdim=True)
    centred = (x - mean).unbind(1)
    differences = [a - b for a, b in combinations(centred, 2)]
    deviations = [value.square().mean((1, 2)).sqrt() for value in (*centred, *differences)]
    return torch.cat([mean[:, :, 0, 0], torch.stack(deviations, 1)], 1)


def _octave(x: Tensor) -> Tensor:
    features = []
    for first, second in _derivatives(x):
        features += [side.relu().square().mean((2, 3)).sqrt() for side in (first, -first, second, -second)]
        features += [torch.hypot(first, second).mean((2, 3))]
    return torch.cat(features, 1)


def _derivatives(x: Tensor) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield first and second derivative along 0°, 45°, 90° and 135° of x blurred by a Gaussian of one texel."""
    (rows, d_rows, dd_rows), (columns, d_columns, dd_columns) = (
        [filter_matrix(side, taps) for taps in _gaussian_taps()] for side in x.shape[-2:]
    )
    smooth, slope = rows @ x, d_rows @ x
    first, second = (smooth @ d_columns.T, slope @ columns.T), (smooth @ dd_columns.T, dd_rows @ x @ columns.T)
    half, mixed = (second[0] + second[1]) / 2, slope @ d_columns.T
    yield first[0], second[0]
    yield (first[0] + first[1]) / math.sqrt(2), half + mixed
    yield first[1], second[1]
    yield (first[0] - first[1]) / math.sqrt(2), half - mixed


@lru_cache(maxsize=1)
def _gaussian_taps() -> tuple[tuple[float, ...], ...]:
    """Return G, G' and G'' of deviation 1 at the integers: 1, t and t²/2 have response 1, and 1 has 0 to G''."""
    t = np.arange(-4, 5)
    blur = np.exp(-(t**2) / 2)
    first, second = t * blur, (t**2 - (t**2 * blur).sum() / blur.sum()) * blur
    taps = blur / blur.sum(), first / (first * t).sum(), second / (second * t**2 / 2).sum()
    return tuple(tuple(value.tolist()) for value in taps)


def standardised(generated: Sequence[Tensor], truth: Sequence[Tensor]) -> tuple[Tensor, Tensor]:
    """Standardise groups of features by the truth's mean and deviation, and join them: (G, d) and (T, d).

    Groups have equal weight: with d features in all, x·y / d is the mean over groups of the mean product of features.
    """
    total = sum(group.shape[1] for group in truth)
    sides: tuple[list[Tensor], list[Tensor]] = ([], [])
    for x, y in zip(generated, truth, strict=True):
        mean, deviation = y.double().mean(0), y.double().std(0).clamp_min(QUANTUM)
        weight = math.sqrt(total / (len(truth) * y.shape[1]))
        for side, group in zip(sides, (x, y)):
            side.append((group.double() - mean) / deviation * weight)
    return torch.cat(sides[0], 1), torch.cat(sides[1], 1)
