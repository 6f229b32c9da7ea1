"""Blocks against what they stand for: a convolution a head, a loop over samples, doublings from 4."""

from __future__ import annotations

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from unproject._types import UserError
from unproject.networks.blocks import HeadConv, ModulatedNorm, SmoothUpsampling, grouped_linear, upsampling_levels

HEAD = torch.tensor([2, 0, 2, 2, 5, 0])


@pytest.mark.parametrize("size, levels", [(8, 1), (16, 2), (32, 3), (64, 4), (128, 5)])
def test_levels_double_from_four(size: int, levels: int) -> None:
    assert upsampling_levels(size) == levels


@pytest.mark.parametrize("size", [-8, 0, 4, 12, 48, 65])
def test_other_sizes_are_refused(size: int) -> None:
    with pytest.raises(UserError, match=f"size {size}: .*choose 8, 16, 32"):
        upsampling_levels(size)


@pytest.mark.parametrize("shape", [(32,), (16,), (32, 32), (16, 32)])
def test_a_vector_becomes_an_image_or_a_line(shape: tuple[int, ...]) -> None:
    block = SmoothUpsampling(inputs=5, channels=16, outputs=3, shape=shape, levels=3)
    assert block(torch.randn(2, 5)).shape == (2, 3, *shape)


def test_modulated_norm_by_hand() -> None:
    # The channel 1, 3 | 5, 7 has mean 4 and variance 5. With h = 2, A = 1 and B = 10: (1 + 2) norm(x) + 20.
    norm = ModulatedNorm(inputs=1, channels=1, dims=1)
    with torch.no_grad():
        norm.modulation.weight.copy_(torch.tensor([[1.0], [10.0]]))
    x = torch.tensor([[[1.0, 3]], [[5.0, 7]]])
    y = norm(x, torch.tensor([[2.0], [0.0]]))
    expected = (x - 4) / 5**0.5
    torch.testing.assert_close(y[0], 3 * expected[0] + 20, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(y[1], expected[1], rtol=1e-4, atol=1e-4)


def test_the_vector_is_heard_at_every_level() -> None:
    block = SmoothUpsampling(inputs=5, channels=64, outputs=16, shape=(16,), levels=2).eval()
    hidden = torch.randn(2, 5)
    for norm in block.norms:
        with torch.no_grad():
            before = block(hidden)
            norm.modulation.weight.mul_(2)
        assert (block(hidden) - before).abs().max() > 1e-4


def arguments(heads: int = 6) -> tuple[Tensor, Tensor, Tensor]:
    rng = torch.Generator().manual_seed(0)
    shapes = ((len(HEAD), 2, 3), (heads, 4, 3), (heads, 4))
    x, weight, bias = (torch.randn(*shape, dtype=torch.float64, generator=rng) for shape in shapes)
    return x.requires_grad_(), weight.requires_grad_(), bias.requires_grad_()


def one_by_one(x: Tensor, weight: Tensor, bias: Tensor, head: Tensor) -> Tensor:
    return torch.stack([F.linear(x[b], weight[h], bias[h]) for b, h in enumerate(head.tolist())])


@pytest.mark.parametrize("head", [HEAD, torch.arange(6), torch.full((6,), 3)], ids=["uneven", "all", "one"])
def test_a_grouped_product_is_a_loop_over_samples(head: Tensor) -> None:
    ours, theirs = arguments(), arguments()
    y, expected = grouped_linear(*ours, head), one_by_one(*theirs, head)
    torch.testing.assert_close(y, expected)
    y.square().sum().backward()
    expected.square().sum().backward()
    for mine, other in zip(ours, theirs):
        torch.testing.assert_close(mine.grad, other.grad)


def test_a_grouped_product_differentiates_twice() -> None:
    assert torch.autograd.gradgradcheck(lambda x, w, b: grouped_linear(x, w, b, HEAD), arguments())


def test_each_sample_passes_the_convolution_of_its_head() -> None:
    block = HeadConv(heads=6, inputs=3, outputs=4)
    x = torch.randn(6, 3, 8, 12, generator=torch.Generator().manual_seed(0))
    y = block(x, HEAD)
    for b, h in enumerate(HEAD.tolist()):
        kernel = block.weight[h].view(4, 3, 4, 4)
        torch.testing.assert_close(y[b], F.conv2d(x[b : b + 1], kernel, block.bias[h], 2, 1)[0], rtol=1e-4, atol=1e-5)


def test_each_line_passes_the_convolution_of_its_head() -> None:
    block = HeadConv(heads=6, inputs=3, outputs=4, dims=1)
    x = torch.randn(6, 3, 12, generator=torch.Generator().manual_seed(0))
    y = block(x, HEAD)
    for b, h in enumerate(HEAD.tolist()):
        kernel = block.weight[h].view(4, 3, 4)
        torch.testing.assert_close(y[b], F.conv1d(x[b : b + 1], kernel, block.bias[h], 2, 1)[0], rtol=1e-4, atol=1e-5)
