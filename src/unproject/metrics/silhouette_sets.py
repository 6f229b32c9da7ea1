"""Distances between generated and held-out real silhouettes, for collections without 3-D references.

MMD, COV and 1-NNA on 1 - IoU (see `shape_sets`), and a kernel distance (see `feature_sets`) on hand-crafted features,
so no weights are downloaded.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn.functional import adaptive_avg_pool1d, adaptive_avg_pool2d

from .._types import UserError
from .distances import THRESHOLD, check_set, one_minus_iou
from .feature_sets import kernel_distance
from .score import Score
from .shape_scores import set_scores

GRID = 16
PROFILE = 32


@torch.no_grad()
def silhouette_scores(generated: Tensor, reference: Tensor, *, seed: int = 0) -> dict[str, Score]:
    """Score generated silhouettes, (N, 1, H, W) or (N, H, W), against reference ones, without gauge or alignment.

    The generated silhouettes must have the references' distribution of views (for unknown views, the estimated one):
    the scores do not separate wrong shapes from a wrong distribution of views.

    Returns:
        `mmd_iou_silhouette`, `cov_iou_silhouette`, `1nna_iou_silhouette`, `kernel_silhouette`.

    Raises:
        UserError: for an empty set, NaN, pictures of different sizes, or fewer than two in a set.

    Examples:
        >>> import torch, unproject as up
        >>> masks = torch.rand(8, 1, 32, 32, generator=torch.Generator().manual_seed(0)).round()
        >>> up.metrics.silhouette_scores(masks, masks)["mmd_iou_silhouette"].value
        0.0
    """
    size = "x".join(map(str, reference.shape[-2:]))
    setting = f"1-iou), silhouettes {size} at {THRESHOLD}, {{}} generated vs {{}} reference, views as given"
    scores = set_scores("iou_silhouette", one_minus_iou, generated, reference, setting, seed)
    value = kernel_distance(silhouette_features(generated), silhouette_features(reference))
    protocol = (
        f"unbiased cubic-kernel mmd^2 on {GRID}x{GRID} coverage + {PROFILE} row + {PROFILE} column profile, "
        + setting.removeprefix("1-iou), ").format(len(generated), len(reference))
    )
    return scores | {"kernel_silhouette": Score(value, protocol, len(generated), seed)}


def silhouette_features(silhouettes: Tensor) -> Tensor:
    """Return features (N, 320) in [0, 1]: the covered shares of 16 × 16 cells, of 32 rows and of 32 columns.

    The cells represent the figure, the row and column profiles its outline in finer resolution. Pictures are
    thresholded at 0.5.
    """
    check_set(silhouettes, "silhouettes")
    if silhouettes.ndim == 3:
        silhouettes = silhouettes[:, None]
    if silhouettes.ndim != 4 or silhouettes.shape[1] != 1:
        raise UserError(f"silhouettes are (N, 1, H, W) or (N, H, W), not {tuple(silhouettes.shape)}")
    mask = (silhouettes > THRESHOLD).float()
    coverage = adaptive_avg_pool2d(mask, GRID).flatten(1)
    rows, columns = adaptive_avg_pool1d(mask.mean(3), PROFILE), adaptive_avg_pool1d(mask.mean(2), PROFILE)
    return torch.cat([coverage, rows[:, 0], columns[:, 0]], 1)
