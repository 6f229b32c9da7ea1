"""Where assignments of unknown views start."""

from __future__ import annotations

import torch
from torch import Tensor

from .._types import UserError
from .panel import Panel
from .responsibilities import uniform_views


def require_unknown_views(panel: Panel, kind: str) -> None:
    """Raise UserError unless a panel has several observations, and one collection for all of them."""
    if len(panel.collections) != 1 or len(panel.observations) < 2:
        raise UserError(f"{kind}: give the panel at least two observations and one collection for all of them")


def views_at_start(panel: Panel, seed: int, kind: str) -> tuple[Tensor, Tensor]:
    """Return uniformly random views (N,), and heads (N,), all the first.

    Raises:
        UserError: as of `require_unknown_views`.
    """
    require_unknown_views(panel, kind)
    views = uniform_views(len(panel), len(panel.observations), seed)
    return views, torch.zeros_like(views)
