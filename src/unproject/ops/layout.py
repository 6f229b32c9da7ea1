"""Layout: the order of a tensor's axes in memory, which decides how fast it is read and leaves its values alone."""

from __future__ import annotations

from torch import Tensor


def repeated_volumes(x: Tensor, times: int) -> Tensor:
    """Return volumes (B, X, Y, Z), each `times` in a row, laid out in memory as (B times, X, Z, Y).

    Level rays read columns of heights in this order without a copy, and the sum over repetitions, which is the
    gradient, reads memory in order.

    Examples:
        >>> import torch
        >>> repeated_volumes(torch.arange(4.0).view(2, 1, 1, 2), 2).flatten(1).tolist()
        [[0.0, 1.0], [0.0, 1.0], [2.0, 3.0], [2.0, 3.0]]
    """
    return x.transpose(2, 3).contiguous().repeat_interleave(times, 0).transpose(2, 3)
