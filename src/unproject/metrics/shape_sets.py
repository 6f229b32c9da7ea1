"""How near a generated set is to a reference set, from the distances between their members.

D is (generated, reference). With G generated and R reference items:

    MMD   = 1/R Σ_r min_g D[g, r]                     fidelity: is there something near every reference?
    COV   = |{argmin_r D[g, r] : g}| / R              diversity: how many references are somebody's nearest?
    1-NNA = leave-one-out accuracy of a nearest-neighbour classifier of generated against reference:
            0.5 if the sets cannot be told apart, 1 if they are separate (below 0.5: copies of the reference).

References:
    Achlioptas et al., Learning Representations and Generative Models for 3D Point Clouds, ICML 2018 (MMD, COV).
    Lopez-Paz & Oquab, Revisiting Classifier Two-Sample Tests, ICLR 2017 (1-NNA), as in PointFlow, ICCV 2019.
"""

from __future__ import annotations

import torch
from torch import Tensor

from .._types import UserError


def minimum_matching_distance(distance: Tensor) -> float:
    """Mean over references (columns) of the least distance to anything generated (rows); lower is better."""
    _check_matrix(distance)
    return distance.amin(0).mean().item()


def coverage(distance: Tensor) -> float:
    """Share of references (columns) that are the nearest one of some generated item (row); higher is better.

    Of equally near references the first counts. It grows with the number of generated items: compare only
    sets of the same sizes.
    """
    _check_matrix(distance)
    return distance.argmin(1).unique().numel() / distance.shape[1]


def one_nearest_neighbour_accuracy(d_gg: Tensor, d_gr: Tensor, d_rr: Tensor) -> float:
    """Share of items whose nearest other item is of their own set; 0.5 is ideal.

    An item equally near to both sets counts one half, so that repeated shapes are not an accident of order.
    The ideal is 0.5 only for sets of equal size.

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
