"""Which sides of objects were seen: the distribution of pictures over azimuth.

The silhouette from the opposite side, a half turn on and from as far below as above, is the flipped silhouette: where a
projection has this property, opposite sides count as one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from .._random import generator_at
from ..metrics import Finding, Score
from ..projections.observation import Observation

CELLS, DRAWS, RARE = 36, 256, 0.25
"""Cells of azimuth; draws of each prior; the share of an even distribution below which a side was seldom seen."""
UNSEEN = (0.25, math.inf)
"""Levels of the share of sides that were seldom seen."""


def seen_from(observations: Sequence[Observation], shares: Tensor) -> Tensor:
    """Return the density of pictures over azimuth, (CELLS,), 1 where it is even.

    Args:
        shares: (K,) how many of the pictures each observation made, as a share.
    """
    density = torch.zeros(CELLS)
    for k, (observation, share) in enumerate(zip(observations, shares.tolist(), strict=True)):
        azimuth = observation.prior.sample(DRAWS, generator_at(0, k, "sides"))["azimuth"]
        cell = (azimuth / (2 * math.pi) * CELLS).floor().long() % CELLS
        density += share * CELLS * torch.bincount(cell, minlength=CELLS) / DRAWS
    return (density + density.roll(CELLS // 2)) / 2 if opposite_sides_agree(observations[0]) else density


@torch.no_grad()
def opposite_sides_agree(observation: Observation) -> bool:
    """Whether pictures of a random volume from opposite sides are each other's mirror images."""
    rng = generator_at(0, 0, "opposite sides")
    x = 0.1 * torch.rand(
        4, *observation.projection.example_shape, generator=rng
    )  # full voxels would make all pictures white
    theta = observation.prior.sample(len(x), rng)
    behind = {name: -value if name in ("elevation", "roll") else value for name, value in theta.items()}
    there = observation.projection(x, **(behind | {"azimuth": theta["azimuth"] + math.pi}))
    return torch.allclose(observation.projection(x, **theta), there.flip(-1), atol=1e-3)


def side_findings(observations: Sequence[Observation], shares: Tensor, known: bool) -> list[Finding]:
    """Judge how much of the objects was seen; nothing for projections without azimuth.

    Args:
        known: whether azimuths are those of the data; otherwise they are up to gauge.
    """
    if "azimuth" not in observations[0].prior.names:
        return []
    density = seen_from(observations, shares)
    rare = density < RARE
    share, seen = rare.float().mean().item(), (density[rare].sum() / CELLS).item()
    how = f"share of azimuths with under {RARE:.0%} of the pictures of an even distribution"
    where = ", ".join(f"from {a}° to {b}°" for a, b in arcs(rare))
    gauge = "" if known else " (up to a turn)"
    says = f"the sides {where}{gauge} were seen in {seen:.0%} of the pictures"
    says += ": they are mostly invented" if share >= UNSEEN[0] else f", and are {share:.0%} of all sides"
    advice = "add pictures from there" if known else "add pictures from there, or lower --balance if there are none"
    return [Finding("sides", Score(share, how, CELLS), *UNSEEN, says if where else "all sides were seen", advice)]


def arcs(rare: Tensor) -> list[tuple[int, int]]:
    """Return the arcs of cells (CELLS,) that are true, (from, to) in degrees; one across 0 ends before it begins."""
    step = 360 // len(rare)
    if bool(rare.all()):
        return [(0, 360)]
    begins = (rare & ~rare.roll(1)).nonzero()[:, 0].tolist()
    lengths = [next(n for n in range(1, len(rare) + 1) if not rare[(b + n) % len(rare)]) for b in begins]
    return [(b * step, (b + n) % len(rare) * step or 360) for b, n in zip(begins, lengths, strict=True)]
