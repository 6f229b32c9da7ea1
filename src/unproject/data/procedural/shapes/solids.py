"""Solids of which procedural shapes are made: coverage in [0, 1] of each voxel, from signed distances in the frame.

A number of B items is (B, 1, 1, 1), so that formulas read as for one; lengths are in units of the frame [-1, 1]³.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import reduce

import torch
from torch import Tensor

from ...._random import generator_at
from ...._types import UserError
from ..span import Span

Point = tuple[Tensor | float, Tensor | float, Tensor | float]
Numbers = Mapping[str, Tensor]


@dataclass(frozen=True)
class Grid:
    """Centres of the voxels along x (mirrored: |x|), y and z, and how wide a voxel is."""

    x: Tensor
    y: Tensor
    z: Tensor
    cell: float

    @staticmethod
    def of(resolution: int) -> Grid:
        centre = (2 * torch.arange(resolution) + 1 - resolution) / resolution
        return Grid(centre.abs()[:, None, None], centre[:, None], centre, 2 / resolution)

    def covered(self, distance: Tensor) -> Tensor:
        """The share of a voxel inside, of a signed distance from its centre."""
        return (0.5 - distance / self.cell).clamp(0, 1)

    def ellipsoid(self, centre: Point, radii: Point, pitch: Tensor | float = 0.0) -> Tensor:
        """Turned by `pitch` radians about x: its +z end up. The distance is exact along the axes."""
        x, y, z = (a - c for a, c in zip((self.x, self.y, self.z), centre, strict=True))
        sine, cosine = torch.sin(torch.as_tensor(pitch)), torch.cos(torch.as_tensor(pitch))
        y, z = y * cosine - z * sine, z * cosine + y * sine
        q = [a / r for a, r in zip((x, y, z), radii, strict=True)]
        length = (q[0] ** 2 + q[1] ** 2 + q[2] ** 2).sqrt()
        slope = sum((a / r) ** 2 for a, r in zip(q, radii, strict=True))
        return self.covered((length - 1) * length / torch.as_tensor(slope).sqrt().clamp(min=1e-6))

    def rod(self, start: Point, end: Point, radius: Tensor | float, last: Tensor | float | None = None) -> Tensor:
        """Between two points, rounded at its ends; its radius goes to `last` if given."""
        at = [a - s for a, s in zip((self.x, self.y, self.z), start, strict=True)]
        along = [torch.as_tensor(e) - s for e, s in zip(end, start, strict=True)]
        square = reduce(torch.add, (d * d for d in along))
        share = (reduce(torch.add, (a * d for a, d in zip(at, along, strict=True))) / square).clamp(0, 1)
        distance = reduce(torch.add, ((a - share * d) ** 2 for a, d in zip(at, along, strict=True))).sqrt()
        return self.covered(distance - (radius if last is None else radius + share * (last - radius)))

    def box(self, centre: Point, half: Point, lean: tuple[Tensor | float, Tensor | float] = (0.0, 0.0)) -> Tensor:
        """Its +z and -z faces lean inwards, by so much of a length for each length up from its floor."""
        x, y, z = (a - c for a, c in zip((self.x, self.y, self.z), centre, strict=True))
        up = y + half[1]
        faces = (x.abs() - half[0], y.abs() - half[1], z - half[2] + lean[0] * up, -z - half[2] + lean[1] * up)
        return reduce(torch.mul, (self.covered(face) for face in faces))

    def wheel(self, centre: Point, radius: Tensor | float, half_width: Tensor | float) -> Tensor:
        """A cylinder along x."""
        x, y, z = (a - c for a, c in zip((self.x, self.y, self.z), centre, strict=True))
        return self.covered(torch.hypot(y, z) - radius) * self.covered(x.abs() - half_width)


def union(*parts: Tensor) -> Tensor:
    return reduce(torch.maximum, parts)


@dataclass(frozen=True)
class ProceduralShapes:
    """Shapes that differ in numbers drawn uniformly within their spans.

    Attributes:
        name: of the stream of random numbers.
        spans: name → span.
        build: (numbers, each (B, 1, 1, 1), and a grid) → coverage (B, N, N, N).
    """

    name: str
    spans: Mapping[str, Span]
    build: Callable[[Numbers, Grid], Tensor]

    def __call__(self, count: int, resolution: int = 32, seed: int = 0, soft: bool = False, chunk: int = 64) -> Tensor:
        """The first `count` of a seed: (count, N, N, N) float32 in {0, 1}, or in [0, 1] if `soft`.

        Raises:
            UserError: if `count` is below 1 or `resolution` below 8.
        """
        if count < 1 or resolution < 8:
            raise UserError(f"{self.name}: give a count of 1 or more (not {count}) and a resolution of 8 or more")
        uniform = torch.rand(count, len(self.spans), generator=generator_at(seed, 0, self.name))
        grid, made = Grid.of(resolution), []
        for part in uniform.split(chunk):
            numbers = {
                name: (s.low + (s.high - s.low) * part[:, k]).view(-1, 1, 1, 1)
                for k, (name, s) in enumerate(self.spans.items())
            }
            volume = self.build(numbers, grid)
            made.append(volume if soft else (volume > 0.5).float())
        return torch.cat(made)
