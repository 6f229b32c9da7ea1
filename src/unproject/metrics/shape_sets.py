"""MMD, COV and 1-NNA: scores of a generated set against a reference set, from the distances of their members.

D is (generated, reference). With G generated and R reference items:

    MMD   = 1/R Σ_r min_g D[g, r]                     fidelity: the mean distance of a reference to the nearest item
    COV   = |{argmin_r D[g, r] : g}| / R              diversity: the share of references nearest to some item
    1-NNA = leave-one-out accuracy of a nearest-neighbour classifier of generated against reference:
            0.5 if the sets are indistinguishable, 1 if they are separate (below 0.5: copies of the reference).

MMD falls and COV grows with G. Given a `size`, both are means over all choices of that many of the generated items,
computed exactly. With C(n, k) choices of k in n, d_(k) the k-th least of a column of D, and G_r
the number of generated items whose nearest reference is r:

    MMD = 1/R Σ_r Σ_k d_(k) C(G - k, size - 1) / C(G, size)        COV = 1/R Σ_r 1 - C(G - G_r, size) / C(G, size)

References:
    Achlioptas et al., Learning Representations and Generative Models for 3D Point Clouds, ICML 2018 (MMD, COV).
    Lopez-Paz & Oquab, Revisiting Classifier Two-Sample Tests, ICLR 2017 (1-NNA), as in PointFlow, ICCV 2019.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .._types import UserError


def minimum_matching_distance(distance: Tensor, size: int | None = None) -> float:
    """Compute the mean over references (columns) of the least distance to a generated item (row); lower is better.

    Args:
        distance: (G, R).
        size: take the mean over all choices of so many rows (default: all rows).

    Examples:
        >>> import torch, unproject as up
        >>> up.metrics.minimum_matching_distance(torch.tensor([[1.0, 4.0], [2.0, 3.0]]))
        2.0
    """
    count = _check_size(distance, size)
    least = torch.arange(1, len(distance) + 1)
    chance = _chance(len(distance) - least, count - 1, len(distance), count).to(distance.device)
    return (chance @ distance.double().sort(0).values).mean().item()


def coverage(distance: Tensor, size: int | None = None) -> float:
    """Compute the share of references (columns) that are nearest to some generated item (row); higher is better.

    Of equally near references the first counts.

    Args:
        distance: (G, R).
        size: take the mean over all choices of so many rows (default: all rows).

    Examples:
        >>> import torch, unproject as up
        >>> up.metrics.coverage(torch.tensor([[1.0, 4.0], [2.0, 3.0]]))
        0.5
    """
    count = _check_size(distance, size)
    nearest = torch.bincount(distance.argmin(1).cpu(), minlength=distance.shape[1])
    return 1 - _chance(len(distance) - nearest, count, len(distance), count).mean().item()


def one_nearest_neighbour_accuracy(d_gg: Tensor, d_gr: Tensor, d_rr: Tensor) -> float:
    """Compute the share of items whose nearest other item is of their own set; 0.5 is ideal, for sets of equal size.

    An item equally near to both sets counts ½, so that the result does not depend on the order.

    Args:
        d_gg: (G, G), the generated among themselves; the diagonal is left out.
        d_gr: (G, R).
        d_rr: (R, R).
    """
    for matrix in (d_gg, d_gr, d_rr):
        _check_matrix(matrix)
    if d_gg.shape != (d_gr.shape[0],) * 2 or d_rr.shape != (d_gr.shape[1],) * 2:
        raise UserError(
            f"1-NNA: give (G, G), (G, R) and (R, R) distances, not {tuple(d_gg.shape)}, {tuple(d_gr.shape)} "
            f"and {tuple(d_rr.shape)}"
        )
    own = torch.cat([_nearest_other(d_gg), _nearest_other(d_rr)])
    other = torch.cat([d_gr.amin(1), d_gr.amin(0)])
    return ((own < other).double() + 0.5 * (own == other).double()).mean().item()


def _nearest_other(distance: Tensor) -> Tensor:
    return distance.clone().fill_diagonal_(float("inf")).amin(1)


def _check_matrix(distance: Tensor) -> None:
    if distance.ndim != 2 or distance.numel() == 0:
        raise UserError(f"distances of shape {tuple(distance.shape)}: both sets need at least one item to be scored")


def _check_size(distance: Tensor, size: int | None) -> int:
    _check_matrix(distance)
    count = len(distance) if size is None else size
    if not 1 <= count <= len(distance):
        raise UserError(f"scores of sets of {count}: there are {len(distance)} generated items; choose 1 to that many")
    return count


def _chance(n: Tensor, k: int, total: int, size: int) -> Tensor:
    """Compute C(n, k) / C(total, size), 0 where k > n."""

    def log_choices(n: Tensor, k: int) -> Tensor:
        n = n.double()
        return (n + 1).lgamma() - torch.tensor(k + 1.0).double().lgamma() - (n - k + 1).lgamma()

    chance = (log_choices(n, k) - log_choices(torch.tensor(total), size)).exp()
    return torch.where(n < k, 0.0, chance)
