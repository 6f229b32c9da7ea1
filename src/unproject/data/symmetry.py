"""The plane of symmetry of objects, found from their volumes or from silhouettes of known azimuth.

Seen from azimuth a, an object that is symmetric about x = 0 shows the flipped silhouette that it shows from -a, one
that is symmetric about z = 0 that from π - a. With m_k the mean silhouette of bin k of K, over the pairs of bins

    E = mean |flip(m_k) - m_k'|²      k' = -k for x = 0, K/2 - k for z = 0

is compared with N, what E would be of symmetric objects (the variances of both means), and with the spread of views
V = mean |m_k - m|² less the variance of the means. Objects are symmetric if (E - N) / V is small. Level orthographic
silhouettes from a and a + π are flipped ones of any object, so pairs of bins half a turn apart say nothing.
"""

from __future__ import annotations

import math
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from .collection import Collection
from .sampling import spread_rows

Plane = Literal["x", "z"]

BINS, MOST = 8, 4096
MAX_ASYMMETRY = 0.2
"""(E - N) / V of symmetric objects, at most: those turned by 5 degrees have 0.05 to 0.2, by 10 degrees 0.3 to 0.6."""
TELLING = 1.5
"""Least V over the variance of a mean: with less, views differ by noise alone and nothing can be said."""
LARGEST_OF_VOLUMES = 0.1
"""|x - flip(x)|² / 2 |x|² of symmetric volumes, at most."""


class Asymmetry(NamedTuple):
    """E, N and V of one plane, and the variance of the mean of a bin; E and N are NaN if no pair of bins tells."""

    difference: float
    expected: float
    spread: float
    variance: float

    @property
    def ratio(self) -> float:
        """(E - N) / V, infinite where nothing can be said."""
        told = self.spread >= TELLING * self.variance and self.spread > 0 and not math.isnan(self.difference)
        return (self.difference - self.expected) / self.spread if told else math.inf


def plane_of_symmetry(collection: Collection) -> Plane | None:
    """Return the plane, x = 0 or z = 0, about which objects are symmetric; None if about neither, or nobody can tell.

    Of two planes it is the one that fits better. Pictures (N, 1, H, W) need `latents["azimuth"]`, and some six of each
    of eight views. They tell by their means: objects that are symmetric on average only are not told apart.

    Examples:
        >>> import torch, unproject as up
        >>> cars = up.data.cars(8, 16)
        >>> [up.data.plane_of_symmetry(up.Collection(x)) for x in (cars, cars.transpose(1, 3))]
        ['x', 'z']
    """
    rows = spread_rows(len(collection), MOST)
    if collection.shape[0] != 1:
        found, largest = asymmetries_of_volumes(collection, rows), LARGEST_OF_VOLUMES
    elif collection.latents is None or "azimuth" not in collection.latents:
        return None
    else:
        of_planes = asymmetries(collection.batch(rows), collection.latents["azimuth"][rows])
        found, largest = {plane: asymmetry.ratio for plane, asymmetry in of_planes.items()}, MAX_ASYMMETRY
    plane: Plane = "x" if found["x"] <= found["z"] else "z"
    return plane if found[plane] <= largest else None


def asymmetries_of_volumes(collection: Collection, rows: Tensor) -> dict[Plane, float]:
    """Return |x - flip(x)|² / 2 |x|² of these volumes for both planes."""
    difference, energy = {"x": 0.0, "z": 0.0}, 0.0
    for some in rows.split(64):
        x = collection.batch(some)
        energy += 2 * x.square().sum().item()
        for plane, axis in (("x", 1), ("z", 3)):
            difference[plane] += (x - x.flip(axis)).square().sum().item()
    return {"x": difference["x"] / energy, "z": difference["z"] / energy} if energy else {"x": math.inf, "z": math.inf}


def asymmetries(silhouettes: Tensor, azimuth: Tensor) -> dict[Plane, Asymmetry]:
    """Return E, N and V of silhouettes (N, 1, H, W) from azimuth (N,) for both planes; NaN if no pairs of bins tell."""
    turns = (azimuth.double() / (2 * math.pi) * BINS).round(decimals=4)  # then a view between two bins is no accident
    bins = turns.round().long() % BINS
    count = torch.bincount(bins, minlength=BINS).double()
    y = silhouettes[:, 0].double()
    sums = y.new_zeros(BINS, *y.shape[1:]).index_add_(0, bins, y)
    means = sums / count.clamp_min(1)[:, None, None]
    within = (y.square().sum() - (count[:, None, None] * means.square()).sum()).item()
    used = int((count > 0).sum())
    noise = max(within, 0.0) / max(len(y) - used, 1)  # of one silhouette, over all pixels
    apart = (means - sums.sum(0) / len(bins)).square().sum((1, 2))
    spread = float(count @ apart - (used - 1) * noise) / len(bins)
    mirrored: dict[Plane, Tensor] = {"x": -torch.arange(BINS) % BINS, "z": (BINS // 2 - torch.arange(BINS)) % BINS}
    return {
        plane: Asymmetry(*_difference(means, count, other, noise), spread, used * noise / len(bins))
        for plane, other in mirrored.items()
    }


def _difference(means: Tensor, count: Tensor, other: Tensor, noise: float) -> tuple[float, float]:
    """Return E and N; a pair of bins counts as its means are known well."""
    told = (other - torch.arange(BINS)) % BINS != BINS // 2
    weight = told / (1 / count + 1 / count[other])  # 0 where a bin is empty
    squares = (means.flip(2) - means[other]).square().sum((1, 2))
    return float(weight @ squares / weight.sum()), float(weight.count_nonzero() * noise / weight.sum())
