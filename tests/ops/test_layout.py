"""Layout: values as without it, memory in the order that level rays read."""

from __future__ import annotations

from itertools import permutations

import pytest
import torch

from unproject.networks import LowRankGenerator
from unproject.ops.azimuth import _columns
from unproject.ops.layout import heights_last, repeated


@pytest.mark.parametrize("order", [*permutations(range(4))])
def test_repetitions_keep_values_gradients_and_the_order_in_memory(order: tuple[int, ...]) -> None:
    back = torch.tensor(order).argsort().tolist()
    x = torch.randn([(2, 3, 4, 5)[k] for k in order], generator=torch.Generator().manual_seed(0)).permute(back)
    x = x.detach().requires_grad_()
    found, plain = repeated(x, 3), x.repeat_interleave(3, 0)
    assert torch.equal(found, plain) and found.permute(order).is_contiguous()
    weight = torch.randn(plain.shape, generator=torch.Generator().manual_seed(1))
    gradients = [torch.autograd.grad((y * weight).sum(), x)[0] for y in (found, plain)]
    torch.testing.assert_close(*gradients)


def test_once_is_the_tensor_itself() -> None:
    x = torch.rand(2, 3)
    assert repeated(x, 1) is x


@pytest.mark.parametrize("mirror", [False, "x", "z"])
def test_silhouettes_read_generated_volumes_without_a_copy(mirror: bool | str) -> None:
    generator = LowRankGenerator(16, 6, 16, rank=3, mirror=mirror)  # pyright: ignore[reportArgumentType]
    x = repeated(generator(torch.randn(2, 6)), 4)
    assert x.shape == (8, 16, 16, 16) and _columns(x).data_ptr() == x.data_ptr()
    assert torch.equal(heights_last(x.contiguous()), x)
