"""Batch: what one panel's discriminator sees at one update."""

from __future__ import annotations

from dataclasses import dataclass, field

import torch
from torch import Tensor

from .state import PanelState


@dataclass
class Batch:
    """Pairs of real and generated images (B, ...), each with its head.

    `seen` are the generated images before any augmentation; `real_logits` is set when the discriminator is updated.
    """

    panel: PanelState
    real: Tensor
    fake: Tensor
    head: Tensor
    rows: Tensor
    seen: Tensor
    real_logits: Tensor = field(default_factory=lambda: torch.empty(0))
