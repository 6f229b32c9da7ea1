"""Unassigned: views are unknown, and one discriminator head sees all of them."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from .._random import shared_draws
from .panel import Assignment, AssignmentState, Panel
from .starting import require_unknown_views


@dataclass(frozen=True)
class Unassigned(Assignment):
    """No image is assigned to an observation; samples are projected by observations drawn uniformly.

    References:
        Gadelha, Maji & Wang 2017, 3D Shape Induction from 2D Views of Multiple Objects (PrGAN).

    Examples:
        >>> import unproject as up
        >>> views = up.projections.azimuth_bins(4, up.Silhouette(size=16))
        >>> panel = up.Panel(views, up.data.observe(up.data.chairs(6, 16), views), up.Unassigned())
        >>> panel.assignment.heads(panel)
        1
    """

    def heads(self, panel: Panel) -> int:
        return 1

    def begin(self, panel: Panel, seed: int) -> UnassignedState:
        require_unknown_views(panel, "Unassigned")
        none = torch.zeros(len(panel), dtype=torch.long)
        return UnassignedState(panel, none, none.clone())


class UnassignedState(AssignmentState):
    """Draws an observation for each sample anew; `views` is unused."""

    def project(self, x: Tensor, rows: Tensor, rng: torch.Generator) -> Tensor:
        source, count, _ = shared_draws(rng, len(x))
        return self.observe(x, self.draw_views(count, source), rng)

    def view_shares(self, real: Tensor) -> None:
        return None

    def draw_views(self, n: int, rng: torch.Generator) -> Tensor:
        count = len(self.panel.observations)
        return torch.multinomial(torch.full((count,), 1 / count), n, replacement=True, generator=rng)
