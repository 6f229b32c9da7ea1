"""Overfitting: what a discriminator says of images that it never trains on, to which augmentations adapt."""

from __future__ import annotations

import torch
from torch import Tensor

from .._random import derived_seed
from ..data.sampling import batch_rows
from .distribution import Distribution
from .recipe import Recipe
from .state import PanelState


@torch.no_grad()
def held_out_logits(
    panel: PanelState, recipe: Recipe, draw: int, index: int, distribution: Distribution
) -> Tensor | None:
    """Return the logits of a batch of held-out images, augmented as all others, if they are measured at this update."""
    held_out = panel.panel.held_out
    if panel.augmentation is None or held_out is None or not panel.augmentation.due(draw):
        return None
    ranks, seed = distribution, derived_seed(recipe.seed, index, "held-out rows")
    rows = ranks.own(batch_rows(len(held_out), recipe.batch * ranks.world, seed, draw))
    rng = ranks.part(recipe.seed, draw, f"held-out augmentation/{index}")
    images = panel.augmentation(held_out.batch(rows).to(ranks.device), rng)
    return panel.discriminator(images, panel.assignment.held_out_heads[rows].long().to(ranks.device))


def adapt(
    panel: PanelState, logits: tuple[Tensor, Tensor, Tensor], progress: float, distribution: Distribution
) -> None:
    """Let a panel's augmentation adapt to the logits of training, held-out and generated images of all processes."""
    assert panel.augmentation is not None
    train, held_out, generated = (distribution.average(part.detach().float().mean().item()) for part in logits)
    panel.augmentation.adapt(train, held_out, generated, progress)
