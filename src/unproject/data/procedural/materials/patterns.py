"""Shapes on a tile that repeats itself: places, coverage, lattices, cells, scratches, and normals of a height.

The tile is the unit square, x to the right and y up, row 0 on top; lengths and heights are in its widths. A pattern
with a whole number of periods has no seam. Coverage is the share of a texel inside a shape, by the distance to the
edge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from ....ops.exposure import linear_from_srgb
from ....ops.maps import normals_of


def texels(size: int) -> tuple[Tensor, Tensor]:
    """x (1, 1, S) and y (1, S, 1) of the texels' centres."""
    middle = (torch.arange(size) + 0.5) / size
    return middle[None, None], (1 - middle)[None, :, None]


def wrapped(d: Tensor) -> Tensor:
    """The nearest of all repetitions of a difference of places: in [-½, ½]."""
    return d - d.round()


def covered(distance: Tensor, size: int, blur: float = 1.0) -> Tensor:
    """1 well inside a shape (distance below 0), 0 outside, a ramp `blur` texels wide at its edge."""
    return (0.5 - distance * (size / blur)).clamp(0, 1)


def smooth(t: Tensor) -> Tensor:
    """3t² - 2t³ of t held to [0, 1]."""
    t = t.clamp(0, 1)
    return t * t * (3 - 2 * t)


def cells(n: Tensor, jitter: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """Distances to the nearest and second nearest of n × n scattered points, in widths of a cell.

    n (B, 1, 1), whole; jitter (B, 2 k²), uniform, with k at least n: how far each point is from its cell's corner.
    """
    x, y = texels(size)
    side = math.isqrt(jitter.shape[1] // 2)
    column, row = (x * n).expand(-1, size, -1), (y * n).expand(-1, -1, size)
    distances = []
    for i in (-1, 0, 1):
        for j in (-1, 0, 1):
            c, r = column.floor() + i, row.floor() + j
            place = (r.remainder(n) * side + c.remainder(n)).long().flatten(1)
            right, up = (jitter.gather(1, 2 * place + axis).view_as(column) for axis in (0, 1))
            distances.append(torch.hypot(c + right - column, r + up - row))
    nearest, second = torch.stack(distances).topk(2, dim=0, largest=False, sorted=True).values
    return nearest, second


def scratches(drawn: Tensor, size: int, longest: float = 0.35, spread: float = math.pi) -> Tensor:
    """Straight scratches: (B, S, S), the depth of the deepest at each texel, between 0 and 1.

    drawn (B, 5 n), uniform: place, direction, length and depth of each; directions lie within `spread` / 2 of x.
    """
    x, y = texels(size)
    deepest = torch.zeros(len(drawn), size, size)
    for one in drawn.view(len(drawn), -1, 5).unbind(1):
        px, py, turn, length, depth = one[:, :, None, None].unbind(1)
        angle = spread * (turn - 0.5)
        right, up = wrapped(x - px), wrapped(y - py)
        along = right * torch.cos(angle) + up * torch.sin(angle)
        across = up * torch.cos(angle) - right * torch.sin(angle)
        end = (along.abs() / (longest * (0.2 + 0.8 * length)) - 0.7) / 0.3
        line = (1 - smooth(end)) * (1 - across.abs() * size).clamp(min=0)
        deepest = torch.maximum(deepest, line * depth**2)
    return deepest


def normals(height: Tensor) -> Tensor:
    """(B, 3, H, W) unit normals of a height (B, H, W), in widths of a tile that repeats itself."""
    return normals_of(height * height.shape[-1])


def colours(srgb: Sequence[tuple[float, float, float]], which: Tensor) -> Tensor:
    """Linear colours (B, 3, 1, 1): entry `which` (B, 1, 1) of a table in sRGB, whole part taken."""
    return linear_from_srgb(torch.tensor(srgb))[which.flatten().long()][:, :, None, None]
