"""Lengths along any axis are those of torch, with their gradients of both orders."""

from __future__ import annotations

import pytest
import torch
import torch.nn.functional as F

from unproject.ops.lengths import LEAST, length, unit

SHAPES = [((3, 5, 4), 0), ((2, 3, 4, 5), 1), ((6, 3), -1), ((2, 2, 7), 1)]


@pytest.mark.parametrize(("shape", "dim"), SHAPES)
def test_they_are_those_of_torch(shape: tuple[int, ...], dim: int) -> None:
    x = torch.randn(shape, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(length(x, dim), torch.linalg.vector_norm(x, dim=dim, keepdim=True))
    torch.testing.assert_close(unit(x, dim), F.normalize(x, dim=dim))


@pytest.mark.parametrize(("shape", "dim"), SHAPES)
def test_so_are_their_gradients(shape: tuple[int, ...], dim: int) -> None:
    x = torch.randn(shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda x: unit(x, dim), (x,))
    assert torch.autograd.gradgradcheck(lambda x: length(x, dim), (x,))


def test_a_vector_of_zeros_stays_one_and_has_finite_gradients() -> None:
    x = torch.zeros(1, 3, 2, 2, requires_grad=True)
    assert length(x, 1).flatten().tolist() == pytest.approx([LEAST] * 4) and not unit(x, 1).any()
    for of in (length, unit):
        (gradient,) = torch.autograd.grad(of(x, 1).sum(), x)
        assert gradient.isfinite().all()


def test_what_is_not_finite_stays_so() -> None:
    assert length(torch.tensor([[float("nan"), 1.0]]), 1).isnan().all()
