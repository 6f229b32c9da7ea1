"""Limits of logits."""

from __future__ import annotations

import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from unproject.ops import limited, penalised


def some(seed: int, size: float) -> Tensor:
    t = torch.randn(3, 4, 5, dtype=torch.float64, generator=torch.Generator().manual_seed(seed)) * size
    return t.requires_grad_(True)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 1000), st.floats(0.1, 100.0), st.floats(0.5, 20.0))
def test_limited_grows_within_its_limits(seed: int, size: float, limit: float) -> None:
    t = some(seed, size).detach().flatten().sort().values
    y = limited(t, limit)
    assert (y.abs() < limit).all() and (y.abs() <= t.abs()).all() and (y.diff() >= 0).all()
    torch.testing.assert_close(limited(t * 1e-3 / size, limit), t * 1e-3 / size, rtol=1e-3, atol=1e-9)


def test_limited_has_a_gradient_far_out() -> None:
    t = torch.tensor([-1e3, 1e3], requires_grad=True)
    limited(t, 10.0).sum().backward()
    assert t.grad is not None and (t.grad > 5e-7).all()
    assert torch.autograd.gradcheck(lambda t: limited(t, 2.0), (some(0, 3.0),))


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 1000), st.floats(0.1, 100.0), st.floats(0.1, 20.0), st.floats(0.0, 2.0))
def test_penalised_has_the_gradient_of_the_penalised_loss(seed: int, size: float, limit: float, weight: float) -> None:
    a, b = some(seed, size), some(seed, size)
    y = penalised(a, limit, weight)
    assert torch.equal(y, a)
    y.sin().sum().backward()
    (b.sin().sum() + weight * (b.abs() - limit).clamp(min=0).square().mean()).backward()
    torch.testing.assert_close(a.grad, b.grad)
