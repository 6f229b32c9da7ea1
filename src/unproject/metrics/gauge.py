"""Gauge: the rotation and reflection that silhouettes, or line integrals, of unknown view leave undetermined.

With P(x, k) the orthographic silhouette of x in azimuth bin k of K (centre 2πk/K, elevation 0), T_t the rotation
`rotate_y` by 2πt/K and F the reflection of x into -x,

    P(T_t x, k) = P(x, k + t)                 the rotated shape, t bins earlier
    P(F x, k)   = mirror of P(x, -k)          a reflected shape from the reflected view
                = P(x, K/2 - k)               as the mirror of P(x, k) is P(x, k + K/2), the opposite view

so every shape of the dihedral family T_t F^r has the same silhouettes after the views are relabelled k → k + t or
k → K/2 - t - k. With perspective and tilted cameras the last line does not hold: a reflection changes the silhouettes,
and is then determined by them.

Images and their line integrals at the angles 2πk/K obey the same two laws, with T_t the rotation by -2πt/K
(`rotate_image`) and F the exchange of left and right. If the angles cover half a turn only, K is twice their number,
and k + K/2, whose line is the same in reverse order, is identified with k: views are relabelled modulo K/2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from .._types import UserError
from ..ops.rotation import quarter_turn, reflect_x, rotate_image, rotate_y
from ..ops.turning import turn_image
from .distances import check_set, one_minus_iou
from .shape_sets import minimum_matching_distance

VOLUMES_AT_ONCE, IMAGES_AT_ONCE = 64, 1024


@dataclass(frozen=True)
class Gauge:
    """T_turn F^reflected: first reflect in x (if `reflected`), then rotate by 2π · turn / bins.

    Raises:
        UserError: if `bins` is odd, since a reflection then does not map bins to bins.

    Examples:
        >>> import torch, unproject as up
        >>> gauge = up.metrics.Gauge(turn=3, bins=16)
        >>> gauge.view(torch.tensor([0, 15])), str(gauge.inverse)
        (tensor([3, 2]), 'turn 13/16')
    """

    turn: int = 0
    reflected: bool = False
    bins: int = 16

    def __post_init__(self) -> None:
        if self.bins < 2 or self.bins % 2:
            raise UserError(f"Gauge: bins must be even and at least 2, not {self.bins}; choose an even number of views")
        object.__setattr__(self, "turn", self.turn % self.bins)

    @property
    def azimuth(self) -> float:
        """The rotation in radians, in [0, 2π)."""
        return 2 * math.pi * self.turn / self.bins

    @property
    def inverse(self) -> Gauge:
        """The inverse gauge; a reflected one is its own inverse: T F T F = T T⁻¹."""
        return self if self.reflected else Gauge(-self.turn, False, self.bins)

    def after(self, first: Gauge) -> Gauge:
        """Return the composition of `first` and then this one."""
        turn = self.turn + (-first.turn if self.reflected else first.turn)
        return Gauge(turn, self.reflected != first.reflected, self.bins)

    def view(self, k: Tensor) -> Tensor:
        """Return the bin in which x has the silhouette that T F x has in bin k: integers, any shape."""
        turned = self.bins // 2 - self.turn - k if self.reflected else k + self.turn
        return turned.remainder(self.bins)

    def azimuth_of(self, azimuth: Tensor) -> Tensor:
        """Return the azimuth, radians, from which x has the silhouette that T F x has from this one."""
        return math.pi - self.azimuth - azimuth if self.reflected else azimuth + self.azimuth

    def __str__(self) -> str:
        return f"turn {self.turn}/{self.bins}{', reflected' if self.reflected else ''}"


def dihedral(bins: int = 16) -> tuple[Gauge, ...]:
    """Return all 2 · bins gauges, the identity first, rotations before reflected ones."""
    return tuple(Gauge(turn, reflected, bins) for reflected in (False, True) for turn in range(bins))


def apply(volumes: Tensor, gauge: Gauge) -> Tensor:
    """Apply T_turn F^reflected to each volume (B, X, Y, Z).

    Quarter turns are exact index permutations. Other rotations interpolate trilinearly, and what leaves the grid
    (outside the cylinder of radius 1) is lost, so such gauges score slightly below their true value.
    """
    volumes = reflect_x(volumes) if gauge.reflected else volumes
    quarters, rest = divmod(4 * gauge.turn, gauge.bins)
    if rest == 0:
        return quarter_turn(volumes, quarters) if quarters else volumes
    return torch.cat([_turned(part, gauge.azimuth) for part in volumes.split(VOLUMES_AT_ONCE)])


def _turned(volumes: Tensor, azimuth: float) -> Tensor:
    return rotate_y(volumes, volumes.new_full((len(volumes),), azimuth))


def apply_to_images(images: Tensor, gauge: Gauge) -> Tensor:
    """Apply T_turn F^reflected to each image (B, C, H, W): first exchange left and right, then rotate clockwise.

    Quarter turns of square images are permutations, other turns have no blur (`ops.turn_image`); those of images that
    are not square are bilinear. What leaves the image is lost.
    """
    images = images.flip(3) if gauge.reflected else images
    square = images.shape[2] == images.shape[3]
    quarters, rest = divmod(4 * gauge.turn, gauge.bins)
    if rest == 0 and square:
        return torch.rot90(images, -quarters, (2, 3)) if quarters else images
    turned = turn_image if square else rotate_image
    return torch.cat(
        [turned(part, part.new_full((len(part),), -gauge.azimuth)) for part in images.split(IMAGES_AT_ONCE)]
    )


@torch.no_grad()
def best_gauge(generated: Tensor, reference: Tensor, bins: int = 16) -> Gauge:
    """Return argmin over gauges g of MMD(1 - IoU) of (g · generated, reference), one gauge for the whole set.

    A gauge chosen on the shapes that are then scored biases the score (it is the best of 2 · bins): choose it on other
    shapes of the same data set, such as the training shapes, if there are any. The first of equal gauges is taken, so
    the identity unless another is strictly better.

    Args:
        generated: (Ng, N, N, N) volumes.
        reference: (Nr, N, N, N) volumes, upright and all in one frame.
        bins: rotations are multiples of 2π / bins.

    Raises:
        UserError: for empty sets, NaN, volumes of different sizes, or an odd number of bins.
    """
    check_set(generated, "generated")
    check_set(reference, "reference")
    return min(dihedral(bins), key=lambda gauge: _mismatch(apply(generated, gauge), reference))


def _mismatch(generated: Tensor, reference: Tensor) -> float:
    return minimum_matching_distance(one_minus_iou(generated, reference))
