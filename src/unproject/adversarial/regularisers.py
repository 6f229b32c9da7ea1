"""Regularisers: terms of the generator's loss besides the adversarial one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import torch
import torch.nn.functional as F
from torch import Tensor

from .._types import UserError
from ..ops.parts import floating_parts
from ..ops.resampling import centres

Regulariser: TypeAlias = Callable[[Tensor, float], Tensor]
"""(x, progress) → a term of the generator's loss."""


TINY = 1e-30
"""So small that empty volumes have a gradient too: a sigmoid underflows at some 1e-38."""


@dataclass(frozen=True)
class Solid:
    """-w E log(mean p): prefer the fullest volume among those with the same silhouettes.

    A thin shell can have the same silhouette as a solid body. The gradient of the logarithm does not depend on how full
    a volume is; the discriminator's gradient stops it at the outline of the silhouette. That gradient weakens during
    training, so w falls linearly from `weight` to `final` over the budget.

    Examples:
        >>> import torch, unproject as up
        >>> up.Solid()(torch.full((2, 4, 4, 4), 0.5), progress=0.0)
        tensor(0.0693)
    """

    weight: float = 0.1
    final: float = 0.01

    def __post_init__(self) -> None:
        if not (0 <= self.weight < math.inf and 0 <= self.final < math.inf):
            raise UserError(f"{self}: give weights of 0 or more")

    def __call__(self, x: Tensor, progress: float) -> Tensor:
        """Return the term of volumes x (B, X, Y, Z) when `progress`, a part of the budget in [0, 1], is spent."""
        weight = self.weight + (self.final - self.weight) * min(progress, 1.0)
        return -weight * (x.flatten(1).mean(1) + TINY).log().mean()


@dataclass(frozen=True)
class Rectilinear:
    """w E log(X Z / (4 Σ m²)): prefer shapes that are rectangles as seen from above, with sides along x and z.

    m = 1 - exp(-density Σ_y p) is the silhouette from above, beyond the volume's walls 0, X = Σ |∂m/∂x| and
    Z = Σ |∂m/∂z|. Of a plan without dents it is the logarithm of the area of its bounding box over its own: 0 of
    rectangles of any length, 0.24 of discs and ellipses along the axes, 0.69 of rhombs. It depends neither on the
    plan's size nor on how dense it is.

    No level camera sees this silhouette, and widths alone do not determine it: wide and narrow pictures can be of wide
    and narrow objects, or of two sides of one long object, and both match. Between such solutions a run drifts, to
    plans that are round or pointed; this term prefers flat sides and corners, from which views can be inferred. Bodies
    of revolution, which pictures cannot rule out, become boxes.

    w is `weight` up to the part `until` of the budget, in which tries are made too, falls geometrically to `final` up
    to a quarter more, and stays there. `Solid` prefers a disc to a square of the same mean width, by 0.24 times its own
    weight, so that w has to be more than that weight.

    Args:
        weight, final: w at the start and at the end.
        until: part of the budget from which on it falls.
        density: a full voxel absorbs 1 - exp(-density).

    Raises:
        UserError: for numbers that are not positive.

    References:
        Rosin 1999, Measuring rectangularity (by the bounding box).

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.zeros(1, 8, 8, 8)
        >>> x[:, 2:6, :4, 2:6] = 1
        >>> abs(up.Rectilinear(1.0, density=20.0)(x, progress=0.0)) < 1e-4
        tensor(True)
    """

    weight: float = 1.0
    final: float = 0.3
    until: float = 0.2
    density: float = 2.0

    def __post_init__(self) -> None:
        if not all(0 < value < math.inf for value in (self.weight, self.final, self.until, self.density)):
            raise UserError(f"{self}: give positive numbers, or leave the term out")

    def __call__(self, x: Tensor, progress: float) -> Tensor:
        """Return the term of volumes x (B, X, Y, Z) when `progress`, a part of the budget in [0, 1], is spent."""
        fallen = min(max(4 * (progress / self.until - 1.0), 0.0), 1.0)
        weight = self.weight * (self.final / self.weight) ** fallen
        plan = _plan(x, self.density)
        along_x, along_z = _edges(plan)
        area = plan.square().flatten(1).sum(1) + TINY
        return weight * (along_x.log() + along_z.log() - (4 * area).log()).mean()


@dataclass(frozen=True)
class Varied:
    """w E log(1 + 2 s² / (Δa² + ε)): prefer worlds whose objects differ in their proportions.

    a is log(W / Y), log(D / Y) or log(W / D), of which the mean is taken, and Δa its difference between two shapes, of
    the first and the second half of the batch; ε = 0.001. With m the silhouette from above, as in `Rectilinear`,
    W = ½ Σ |∂m/∂z| and D = ½ Σ |∂m/∂x|, the sides of a rectangle along x and z, and Y is the height,
    Σ_y (1 - exp(-density Σ_xz p)). Shapes that differ by much more than s = `spread` are not pushed.

    Wide and narrow pictures can be of different objects, or of two sides of one; both match. A generator whose shapes
    hardly differ yet explains them by sides, views are assigned accordingly, and so it stays: all objects have one
    plan, or one side the same to a voxel. A weight as small as this decides for objects that differ where pictures
    leave it open; where they do not, discriminators override it.

    w is 0 up to the part `begin` of the budget and rises to `weight` by half as much again. Where views can be told
    they are found first: from the start on it would make cars as wide as they are long.

    Args:
        weight: w.
        spread: s, the deviation of a up to which shapes are to differ.
        begin: part of the budget.
        density: a full voxel absorbs 1 - exp(-density).

    Raises:
        UserError: for numbers that are not positive.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.zeros(2, 8, 8, 8)
        >>> x[0, 2:6, :4, 2:6], x[1, 1:7, :4, 3:5] = 1, 1
        >>> alike, different = x[:1].repeat(2, 1, 1, 1), x
        >>> up.Varied()(different, progress=1.0) < 0.2 * up.Varied()(alike, progress=1.0)
        tensor(True)
    """

    weight: float = 0.1
    spread: float = 0.3
    begin: float = 0.2
    density: float = 2.0

    def __post_init__(self) -> None:
        numbers = (self.weight, self.spread, self.begin, self.density)
        if not all(0 < value < math.inf for value in numbers):
            raise UserError(f"{self}: give positive numbers, or leave the term out")

    def __call__(self, x: Tensor, progress: float) -> Tensor:
        """Return the term of volumes x (B, X, Y, Z) when `progress`, a part of the budget in [0, 1], is spent.

        Of an odd number the last is left out; of a single volume it is 0.
        """
        half = len(x) // 2
        if not half:
            return 0.0 * x.sum()
        depth, width = _edges(_plan(x, self.density))  # twice of each, which differences do not hold
        height = (1 - torch.exp(-self.density * x.sum((1, 3)))).sum(1) + TINY
        sizes = torch.stack([width, depth, height]).log()
        proportions = sizes - sizes.roll(1, 0)
        apart = (proportions[:, :half] - proportions[:, half : 2 * half]).square()
        alike = torch.log1p(2 * self.spread**2 / (apart + LEAST_APART))
        return self.weight * min(max(2 * (progress / self.begin - 1.0), 0.0), 1.0) * alike.mean()


LEAST_APART = 1e-3
"""ε: differences under 3 % are less than a voxel's."""


def _plan(x: Tensor, density: float) -> Tensor:
    """The silhouettes from above (B, X + 2, Z + 2) of volumes (B, X, Y, Z), 0 beyond their walls."""
    return F.pad(1 - torch.exp(-density * x.sum(2)), (1, 1, 1, 1))


def _edges(plan: Tensor) -> tuple[Tensor, Tensor]:
    """Σ |∂m/∂x| and Σ |∂m/∂z| of plans, (B,): twice the depth and the width of rectangles."""
    along_x, along_z = (plan.diff(dim=axis).abs().flatten(1).sum(1) + TINY for axis in (1, 2))
    return along_x, along_z


@dataclass(frozen=True)
class Connected:
    """w t E[(Σ_F p + Σ_G (1 - p)) / Σ p] when a part t of the budget is spent: prefer shapes in one piece.

    F are the voxels of parts that float, G those of small gaps (`ops.floating_parts`): what floats far from the largest
    part goes, and a part within two voxels of it, such as a broken leg, is joined to it rather than taken away. Other
    voxels are not pushed; Σ p has no gradient here.

    Args:
        weight: w, which the term has at the end; early on shapes are to become what they are first.
        level: parts are connected sets of voxels above it.
        volumes: the mean is taken of so many volumes of the batch, to save time; as codes are drawn independently, its
            expectation is that of all.

    Raises:
        UserError: for a negative weight, a level outside of 0 to 1, or no volume.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.zeros(1, 8, 8, 8)
        >>> x[:, :4, :4, :4], x[:, 7, 7, 7] = 1, 1  # a block of 64 voxels, and a crumb
        >>> up.Connected()(x, progress=1.0)
        tensor(0.0154)
    """

    weight: float = 1.0
    level: float = 0.5
    volumes: int = 4

    def __post_init__(self) -> None:
        if not (0 <= self.weight < math.inf and 0 < self.level < 1 and self.volumes >= 1):
            raise UserError(f"{self}: give a weight of 0 or more, a level between 0 and 1 and at least one volume")

    def __call__(self, x: Tensor, progress: float) -> Tensor:
        """Return the term of volumes x (B, X, Y, Z) when `progress`, a part of the budget in [0, 1], is spent."""
        x = x[: self.volumes]
        floating, gaps = floating_parts(x, self.level)
        misplaced = (x * floating + (1 - x) * gaps).flatten(1).sum(1)
        total = x.detach().flatten(1).sum(1) + 1e-6
        return self.weight * min(progress, 1.0) * (misplaced / total).mean()


@dataclass(frozen=True)
class Centred:
    """w E|m|², with the centre of mass m = Σ r p / Σ p along some axes: for shapes whose place there may be any.

    Pictures that were cropped to the object say nothing of its place, and the gradient of a cropped picture lacks that
    of the crop: what it asks to be further right goes there and is brought back, without end, until the volume's walls
    cut shapes off. r runs from -1 to 1 along each axis.

    Args:
        weight: w.
        axes: along which place is free. Level cropped pictures tell how high objects are and stand: "xz".

    Raises:
        UserError: for a negative weight, or axes other than some of x, y and z.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.zeros(1, 8, 8, 8)
        >>> x[:, 2:6, 2:6, 4:8] = 1
        >>> up.Centred(1.0)(x, progress=0.0)
        tensor(0.2500)
    """

    weight: float = 10.0
    axes: str = "xyz"

    def __post_init__(self) -> None:
        if not (0 <= self.weight < math.inf and self.axes and set(self.axes) <= set("xyz")):
            raise UserError(f"{self}: give a weight of 0 or more, and some of the axes xyz")

    def __call__(self, x: Tensor, progress: float) -> Tensor:
        """Return the term of volumes x (B, X, Y, Z), whatever is spent of the budget."""
        total = x.flatten(1).sum(1) + TINY
        kept_axes = ["xyz".index(name) + 1 for name in self.axes]
        sums = [x.sum([axis for axis in (1, 2, 3) if axis != kept]) for kept in kept_axes]
        middle = torch.stack([part @ centres(part.shape[1], part) / total for part in sums])
        return self.weight * middle.square().sum(0).mean()


@dataclass(frozen=True)
class Regularisers:
    """The sum of several regularisers.

    Examples:
        >>> import torch, unproject as up
        >>> up.Regularisers((up.Solid(), up.Connected()))(torch.full((2, 4, 4, 4), 0.5), progress=0.0)
        tensor(0.0693)
    """

    terms: tuple[Regulariser, ...]

    def __call__(self, x: Tensor, progress: float) -> Tensor:
        """Return the sum of the terms."""
        return torch.stack([term(x, progress) for term in self.terms]).sum()
