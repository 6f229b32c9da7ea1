"""Loss balancing: each panel's loss divided by the norm of its gradient by the generator's parameters.

Otherwise a panel whose images vary little, and are magnified most, would dominate the generator's gradient.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from .distribution import Distribution
from .state import State


def balanced_loss(state: State, losses: Sequence[Tensor], measure_on: Distribution | None) -> tuple[Tensor, Tensor]:
    """Return (Σ w_i L_i, Σ w_i / g_i L_i) of the losses of the panels; the first is detached, for the log.

    Args:
        measure_on: if given, the norms g_i are measured first, and averaged over its processes.
    """
    if measure_on is not None:
        measure_gradient_norms(state, losses, measure_on)
    total = torch.zeros((), device=state.device)
    balanced = total
    for panel, loss in zip(state.panels, losses, strict=True):
        total = total + panel.panel.weight * loss.detach()
        balanced = balanced + panel.panel.weight / panel.gradient_norm * loss
    return total, balanced


def measure_gradient_norms(state: State, losses: Sequence[Tensor], distribution: Distribution) -> None:
    """Move each panel's `gradient_norm` halfway, geometrically, to the norm of its loss's gradient."""
    parameters = [p for p in state.generator.parameters() if p.requires_grad]
    for panel, loss in zip(state.panels, losses, strict=True):
        gradients = torch.autograd.grad(loss, parameters, retain_graph=True, allow_unused=True)
        norm = torch.stack([g.float().square().sum() for g in gradients if g is not None]).sum().sqrt()
        found = max(distribution.average(norm.item()), 1e-12)
        first = state.counters.step == 0
        panel.gradient_norm = found if first else (panel.gradient_norm * found) ** 0.5
