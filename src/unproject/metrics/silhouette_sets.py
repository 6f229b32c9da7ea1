"""How near generated silhouettes are to held-out real ones: where there is no 3-D to compare with.

MMD, COV and 1-NNA on 1 - IoU (see `shape_sets`), and a kernel distance (see `feature_sets`) on fixed features made
by hand, so no weights are downloaded.
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
    """Distances of two sets of silhouettes, (N, 1, H, W) or (N, H, W), as they are: no gauge, no alignment.

    Draw the generated ones from the view distribution the references have (for unknown views, the estimated
    one); the scores cannot tell a wrong shape from a wrong mix of views.

    Returns:
        `mmd_iou_silhouette`, `cov_iou_silhouette`, `1nna_iou_silhouette`, `kernel_silhouette`.

    Raises:
        UserError: for an empty set, NaN, pictures of different sizes, or fewer than two in a set.
    """
    size = "x".join(map(str, reference.shape[-2:]))
    setting = f"1-iou), silhouettes {size} at {THRESHOLD}, {{}} generated vs {{}} held-out, views as given"
    scores = set_scores("iou_silhouette", one_minus_iou, generated, reference, setting, seed)
    value = kernel_distance(silhouette_features(generated), silhouette_features(reference))
    protocol = (
        f"unbiased cubic-kernel mmd^2 on {GRID}x{GRID} coverage + {PROFILE} row + {PROFILE} column profile, "
        + setting.removeprefix("1-iou), ").format(len(generated), len(reference))
    )
    return scores | {"kernel_silhouette": Score(value, protocol, len(generated), seed)}


def silhouette_features(silhouettes: Tensor) -> Tensor:
    """(N, 320) in [0, 1]: what share of each cell of a 16 × 16 grid, each of 32 row and of 32 column bands is filled.

    The coverage says where the figure is, the profiles keep its outline in height and width finer than the
    grid does. Pictures are made binary at 0.5 first.
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
