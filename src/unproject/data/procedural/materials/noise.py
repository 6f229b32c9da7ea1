"""The randomness of procedural materials, and noise that repeats itself.

All that is random about item k of a seed comes from a generator of its own: uniform numbers by name, and for each noise
field the Fourier coefficients c of frequencies up to 63 cycles a tile. A field is its filter w over them,

    f(x) = Σ_q w(|q|) c_q exp(2πi q·x),   then mean 0 and variance 1 over the tile

so it repeats itself without a seam, and at another size it is the same field, sampled elsewhere. Filters:

    clouds    |q|^-slope exp(-(|q|/24)²)                  alike at every scale, soft at the finest
    grain     exp(-½ ((|q| - centre)/width)²)             blobs of one size
    streaks   exp(-(q_x/across)² - (q_y/along)²)          long in y where `along` is the smaller

A field or a number of B items is (B, H, W) or (B, 1, 1), so that formulas read as for one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from ...._random import generator_at
from ..span import Span

SOFT = 24.0
FINEST = 128  # side of the square of Fourier coefficients: sizes above it get no finer noise


@dataclass(frozen=True)
class Chances:
    """What is random about the items of a procedural data set: named numbers, tables of them, and noise fields."""

    name: str
    numbers: Mapping[str, Span]
    tables: Mapping[str, int]  # name → how many uniform numbers
    waves: Sequence[str]


@dataclass(frozen=True)
class Draws:
    """The chances of B items, drawn, for maps of one size."""

    chances: Chances
    uniform: Tensor  # (B, all numbers and tables)
    waves: Tensor  # (B, fields, rows, columns) complex
    size: int

    def __getitem__(self, name: str) -> Tensor:
        """The number of a name, (B, 1, 1), between its ends."""
        span, place = self.chances.numbers[name], list(self.chances.numbers).index(name)
        return (span.low + (span.high - span.low) * self.uniform[:, place])[:, None, None]

    def table(self, name: str) -> Tensor:
        """The uniform numbers (B, n) of a table."""
        sizes = list(self.chances.tables.values())
        start = len(self.chances.numbers) + sum(sizes[: list(self.chances.tables).index(name)])
        return self.uniform[:, start : start + self.chances.tables[name]]

    def take(self, rows: Tensor) -> Draws:
        """Those of some of the items."""
        return replace(self, uniform=self.uniform[rows], waves=self.waves[rows])

    def clouds(self, name: str, slope: Tensor | float) -> Tensor:
        def weight(x: Tensor, y: Tensor) -> Tensor:
            q = torch.hypot(x, y).clamp(min=1)
            return q ** -_number(slope) * torch.exp(-((q / SOFT) ** 2))

        return self._field(name, weight)

    def grain(self, name: str, centre: Tensor | float, width: Tensor | float) -> Tensor:
        return self._field(
            name, lambda x, y: torch.exp(-0.5 * ((torch.hypot(x, y) - _number(centre)) / _number(width)) ** 2)
        )

    def streaks(self, name: str, across: Tensor | float, along: Tensor | float) -> Tensor:
        return self._field(name, lambda x, y: torch.exp(-((x / _number(across)) ** 2) - (y / _number(along)) ** 2))

    def _field(self, name: str, weight: Callable[[Tensor, Tensor], Tensor]) -> Tensor:
        c = self.waves[:, list(self.chances.waves).index(name)]
        y = torch.fft.fftfreq(c.shape[1], 1 / c.shape[1])[:, None]
        x = torch.arange(c.shape[2], dtype=torch.float32)
        return standardised(torch.fft.irfft2(self._at_size(weight(x, y) * c), s=(self.size, self.size)))

    def _at_size(self, c: Tensor) -> Tensor:
        """Coefficients for a grid of another side: those it cannot show left out, those there are not 0."""
        keep = (min(self.size, c.shape[1]) + 1) // 2
        out = c.new_zeros(len(c), self.size, self.size // 2 + 1)
        out[:, :keep, :keep] = c[:, :keep, :keep]
        out[:, 1 - keep :, :keep] = c[:, 1 - keep :, :keep]
        out[:, 0, 0] = 0
        return out


def _number(value: Tensor | float) -> Tensor:
    return torch.as_tensor(value, dtype=torch.float32)


def draw(chances: Chances, items: range, size: int, seed: int) -> Draws:
    """Of the items of a seed; each depends on its own index alone."""
    count = len(chances.numbers) + sum(chances.tables.values())
    shape = (len(chances.waves), FINEST, FINEST // 2 + 1, 2)
    uniform, waves = torch.empty(len(items), count), torch.empty(len(items), *shape)
    for row, item in enumerate(items):
        own = generator_at(seed, item, f"materials, {chances.name}")
        uniform[row] = torch.rand(count, generator=own)
        waves[row] = torch.randn(shape, generator=own)
    return Draws(chances, uniform, torch.view_as_complex(waves), size)


def standardised(f: Tensor) -> Tensor:
    """With mean 0 and variance 1 over each of the (B, H, W)."""
    f = f - f.mean((1, 2), keepdim=True)
    return f / f.square().mean((1, 2), keepdim=True).sqrt().clamp(min=1e-12)


def by_kind(kind: Tensor, builders: Sequence[Callable[[Draws], Tensor]], draws: Draws) -> Tensor:
    """Each item's picture by the builder that its `kind` (B, ...) counts: a number whose whole part is an index."""
    which = kind.flatten().long()
    rows = [(which == k).nonzero()[:, 0] for k in range(len(builders))]
    made = [(r, build(draws.take(r))) for r, build in zip(rows, builders) if len(r)]
    out = made[0][1].new_empty(len(which), *made[0][1].shape[1:])
    for r, picture in made:
        out[r] = picture
    return out
