"""Space: where the samples of a run lie among its latents, and the directions in which they differ most.

A place is v = ψ slerp(v_a, v_b, t) + Σ s_k d_k in whitened latents (`inversion.LatentSpace`): picks a and b, their mix
t, the truncation ψ and the positions s_k of the sliders, in standard deviations. The directions d_k are the first left
singular vectors of the covariance of v and x(v), the samples: as v is white, that is the linear map that fits best.

References:
    Härkönen et al. 2020, GANSpace (directions from principal components).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from .._random import generator_at
from .._types import UserError
from ..inversion import LatentSpace
from ..training import Run
from .answers import Request

DIRECTIONS, PICKS = 8, 96
"""Sliders, and samples to pick from."""
COMPARED, COARSE, FEW_CODES = 256, 16, 512
"""Samples that directions are found by, their side when compared, and codes where there is noise behind them."""
FURTHEST = 4.0


@dataclass(frozen=True, eq=False)
class Space:
    """The latents of a run.

    Attributes:
        run: the run.
        latents: its whitened latents.
        directions: (K, r + white), of length 1.
        picks: (N, r + white), the places of samples 0 to N - 1 of seed 0.
    """

    run: Run
    latents: LatentSpace
    directions: Tensor
    picks: Tensor

    @classmethod
    @torch.no_grad()
    def of(cls, run: Run) -> Space:
        """Return the space of a run, from a few hundred samples."""
        generator = run.generator
        many = {} if generator.white == 0 else {"count": FEW_CODES}
        space = LatentSpace.of(generator, **many)
        picks = space.whitened(generator.map_code(generator.codes(PICKS)).flatten(1))
        return cls(run, space, _directions(run, space), picks)

    def place(self, request: Request) -> Tensor:
        """Return the place (1, r + white) that an address names.

        Raises:
            UserError: if it names none.
        """
        a = self.picks[request.whole("pick", 0, 0, PICKS - 1)]
        b = self.picks[request.whole("other", request.whole("pick", 0, 0, PICKS - 1), 0, PICKS - 1)]
        v = slerp(a, b, request.number("mix", 0, 0, 1)) * request.number("truncation", 1, 0, 1)
        slides = torch.tensor(_numbers(request.text("slides", "")))[: len(self.directions)]
        return (v + slides @ self.directions[: len(slides)])[None]

    @torch.no_grad()
    def samples(self, v: Tensor) -> Tensor:
        """Return samples (B, ...) of places (B, r + white), as `run.sample` makes them."""
        generator = self.run.generator
        return generator.filled(generator.synthesise(self.latents.latents(v)).float())


def slerp(a: Tensor, b: Tensor, t: float) -> Tensor:
    """Return what lies between two places on the arc, whose length goes from one's to the other's.

    Examples:
        >>> slerp(torch.tensor([2.0, 0.0]), torch.tensor([0.0, 2.0]), 0.5)
        tensor([1.4142, 1.4142])
    """
    length_a, length_b = a.norm().clamp_min(1e-6), b.norm().clamp_min(1e-6)
    angle = torch.arccos(torch.dot(a / length_a, b / length_b).clamp(-1, 1))
    if angle < 1e-3:
        return a + t * (b - a)
    across = (torch.sin((1 - t) * angle) * a / length_a + torch.sin(t * angle) * b / length_b) / torch.sin(angle)
    return across * (length_a + t * (length_b - length_a))


def _numbers(text: str) -> list[float]:
    try:
        found = [float(part) for part in text.split(",")] if text else [0.0]
    except ValueError:
        found = []
    if not 1 <= len(found) <= DIRECTIONS or not all(abs(value) <= FURTHEST for value in found):
        raise UserError(f"slides={text[:80]}: give up to {DIRECTIONS} numbers from -{FURTHEST:g} to {FURTHEST:g}")
    return found


def _directions(run: Run, space: LatentSpace) -> Tensor:
    """Return the directions (K, r + white); of generators with noise behind the latents the longest axes of these."""
    count, axes = min(DIRECTIONS, len(space.axes)), len(space.axes)
    if space.white:  # its samples take long, and the noise says nothing of the kind of sample
        return F.pad(torch.eye(axes)[:count], (0, space.white))
    codes = run.generator.draw(COMPARED, generator_at(0, 0, "directions"))
    w = run.generator.map_code(codes).flatten(1)
    x = torch.cat([_coarse(run.generator.synthesise(some)) for some in w.split(32)])
    v = space.whitened(w)
    covariance = (v - v.mean(0)).T @ (x - x.mean(0)) / len(v)
    found, _, _ = torch.linalg.svd(covariance, full_matrices=False)
    return found.T[:count].contiguous()


def _coarse(x: Tensor) -> Tensor:
    """Return samples (B, n), volumes and pictures on a coarse grid: fine detail is not what makes them differ."""
    side = min(COARSE, x.shape[-1])
    if x.dim() == 4 and x.shape[1] > 3:
        return F.adaptive_avg_pool3d(x[:, None], side).flatten(1)
    return F.adaptive_avg_pool2d(x, side).flatten(1) if x.dim() == 4 else x.flatten(1)
