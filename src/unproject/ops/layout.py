"""Layout: the order of a tensor's axes in memory, which decides how fast it is read and leaves its values alone."""

from __future__ import annotations

from torch import Tensor


def repeated(x: Tensor, times: int) -> Tensor:
    """Return x (B, ...) with each element `times` in a row, (B times, ...), in the order that x has in memory.

    The sum over repetitions, its gradient, reads memory in order then.

    Examples:
        >>> import torch
        >>> repeated(torch.tensor([[1, 2], [3, 4]]), 2).tolist()
        [[1, 2], [1, 2], [3, 4], [3, 4]]
    """
    if times == 1:
        return x
    order = sorted(range(x.dim()), key=x.stride, reverse=True)  # of equal strides the first stays first
    back = sorted(range(x.dim()), key=order.__getitem__)
    return x.permute(order).repeat_interleave(times, order.index(0)).permute(back)


def heights_last(x: Tensor) -> Tensor:
    """Return volumes (B, X, Y, Z) in the order (Z, B, X, Y) in memory, in which level rays read them without copies."""
    return x.permute(3, 0, 1, 2).contiguous().permute(1, 2, 3, 0)
