"""Loss balancing: each term of the generator's loss divided by the norm of its gradient by the generator's parameters.

Otherwise a panel whose images vary little, and are magnified most, would dominate the generator's gradient.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import torch
from torch import Tensor

from .distribution import Distribution
from .state import State


class Measured(Protocol):
    """What keeps the norm of a gradient."""

    @property
    def gradient_norm(self) -> float: ...

    @gradient_norm.setter
    def gradient_norm(self, value: float) -> None: ...


class Term(NamedTuple):
    """A term w L of the loss, and what keeps the norm g of the gradient of L."""

    weight: float
    loss: Tensor
    owner: Measured


def balanced_loss(state: State, terms: Sequence[Term], measure_on: Distribution | None) -> tuple[Tensor, Tensor]:
    """Return (Σ w_i L_i, Σ w_i / g_i L_i); the first is detached, for the log. Norms never measured count as 1.

    Args:
        measure_on: if given, the norms g_i are measured first, and averaged over its processes.
    """
    if measure_on is not None:
        measure_gradient_norms(state, terms, measure_on)
    total = torch.zeros((), device=state.device)
    balanced = total
    for weight, loss, owner in terms:
        total = total + weight * loss.detach()
        balanced = balanced + weight / (owner.gradient_norm or 1.0) * loss
    return total, balanced


def measure_gradient_norms(state: State, terms: Sequence[Term], distribution: Distribution) -> None:
    """Move each `gradient_norm` halfway, geometrically, to the norm of its term's gradient; the first time whole."""
    parameters = [p for p in state.generator.parameters() if p.requires_grad]
    for _, loss, owner in terms:
        gradients = torch.autograd.grad(loss, parameters, retain_graph=True, allow_unused=True)
        norm = torch.stack([g.float().square().sum() for g in gradients if g is not None]).sum().sqrt()
        found = max(distribution.average(norm.item()), 1e-12)
        owner.gradient_norm = (owner.gradient_norm * found) ** 0.5 if owner.gradient_norm else found
