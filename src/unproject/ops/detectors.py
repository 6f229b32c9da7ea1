"""Rows of detectors that measured lines, and where the axis of rotation projects to."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from .._types import UserError


def about_middle(lines: Tensor, center: float | None, source: str = "memory") -> Tensor:
    """Return lines (N, 1, D') whose middle is where the axis of rotation projects to.

    Zeros are appended at the end that is too short. If 2 `center` is no integer, lines are interpolated as well.

    Raises:
        UserError: for a center outside of the detectors.

    Examples:
        >>> import torch
        >>> about_middle(torch.tensor([[[1.0, 2.0, 3.0, 4.0]]]), 2)  # scikit-image's, of an even number
        tensor([[[1., 2., 3., 4., 0.]]])
    """
    last = lines.shape[-1] - 1
    if center is None:
        return lines
    if not 0 <= center <= last:
        raise UserError(f"{source}: center={center:g}: give a detector of those there are, 0 to {last}")
    doubled = round(2 * center)
    short = last - doubled  # how many zeros go before the first detector; behind the last one if negative
    lines = F.pad(lines, (max(short, 0), max(-short, 0)))
    by = center - doubled / 2
    if not by:
        return lines
    step = F.pad(lines, (0, 1))[..., 1:] if by > 0 else F.pad(lines, (1, 0))[..., :-1]
    return torch.lerp(lines, step, abs(by))
