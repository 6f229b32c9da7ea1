"""Distances between generated and real projections that are no silhouettes: depth, thickness, photographs."""

from __future__ import annotations

import torch
from torch import Tensor

from .._types import UserError
from .distances import check_set
from .score import Score
from .shape_scores import set_scores


def root_mean_square(a: Tensor, b: Tensor) -> Tensor:
    """Return the root mean square differences (A, B) of pictures (A, ...) and (B, ...).

    In 64 bits and less the mean of b: |a|² - 2 ab + |b|², as `torch.cdist` has it, loses what pictures have in common.

    Examples:
        >>> root_mean_square(torch.zeros(1, 4), torch.tensor([[1.0, 1.0, 1.0, 1.0], [2.0, 0.0, 0.0, 0.0]]))
        tensor([[1., 1.]])
    """
    a, b = a.flatten(1).double(), b.flatten(1).double()
    middle = b.mean(0)
    return (torch.cdist(a - middle, b - middle) / max(a.shape[1], 1) ** 0.5).float()


@torch.no_grad()
def picture_scores(generated: Tensor, reference: Tensor, *, seed: int = 0) -> dict[str, Score]:
    """Score generated pictures (N, C, H, W) against reference ones by their root mean square differences.

    As of silhouettes (`silhouette_scores`), the generated ones must have the references' distribution of views.

    Returns:
        `mmd_rms_picture`, `cov_rms_picture`, `1nna_rms_picture`: see `shape_sets`.

    Raises:
        UserError: for an empty set, NaN, pictures of different sizes, or fewer than two in a set.

    Examples:
        >>> import torch, unproject as up
        >>> depth = torch.rand(8, 1, 16, 16, generator=torch.Generator().manual_seed(0))
        >>> up.metrics.picture_scores(depth, depth)["mmd_rms_picture"].value < 1e-3
        True
    """
    for pictures, name in ((generated, "generated"), (reference, "reference")):
        check_set(pictures, name)
    if generated.shape[1:] != reference.shape[1:] or min(len(generated), len(reference)) < 2:
        raise UserError(
            f"picture scores: give at least two pictures of one size a set, not {tuple(generated.shape)} and "
            f"{tuple(reference.shape)}"
        )
    size = "x".join(map(str, reference.shape[1:]))
    setting = f"root mean square), pictures {size}, {{}} generated vs {{}} reference, views as given"
    return set_scores("rms_picture", root_mean_square, generated, reference, setting, seed)
