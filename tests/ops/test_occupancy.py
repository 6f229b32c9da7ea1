"""The rules along a ray against hand-computed values."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from unproject.ops import absorption, any_occupied, capped_sum, expected_depth

rays = st.lists(st.floats(0, 1, width=32), min_size=1, max_size=12).map(torch.tensor)


@pytest.mark.parametrize(
    "ray, value",
    [([0.0, 0], 0), ([0.5, 0.5], 0.75), ([0.1, 0.2, 0.3], 1 - 0.9 * 0.8 * 0.7), ([1, 0.3], 1), ([1.0, 1], 1)],
)
def test_any_occupied(ray: list[float], value: float) -> None:
    assert any_occupied(torch.tensor(ray)).item() == pytest.approx(value, abs=1e-6)


@pytest.mark.parametrize(
    "ray, gradient",
    [([0.5, 0.2, 0.0], [0.8, 0.5, 0.4]), ([1.0, 0.2, 0.5], [0.4, 0, 0]), ([1.0, 1.0, 0.5], [0, 0, 0]), ([0.0], [1])],
)
def test_gradient_of_any_occupied_is_the_product_of_the_others(ray: list[float], gradient: list[float]) -> None:
    p = torch.tensor(ray, requires_grad=True)
    any_occupied(p).backward()
    assert p.grad is not None and p.grad.tolist() == pytest.approx(gradient, abs=1e-5)


def test_any_occupied_of_a_long_opaque_ray_has_a_finite_gradient() -> None:
    p = torch.ones(500, requires_grad=True)
    any_occupied(p).backward()
    assert p.grad is not None and p.grad.abs().max() == 0


def test_rounding_above_one_is_harmless() -> None:
    p = torch.tensor([1 + 2e-7, 0.5], requires_grad=True)
    any_occupied(p).backward()
    assert p.grad is not None and p.grad.tolist() == pytest.approx([0.5, 0], abs=1e-5)


@pytest.mark.parametrize(
    "ray, value",
    [
        ([0, 0, 0], 0),
        ([0.25, 0.25], 0.5),
        ([0.5, 0.5, 0.5], 1),  # the sum reaches 1 exactly: kept
        ([0.3, 1, 1], 0.3),  # 1.3 passes 1: that sample and all behind it are dropped
        ([1, 1, 1], 1),
        ([0.6, 0.6, 0.1], 0.6),
    ],
)
def test_capped_sum(ray: list[float], value: float) -> None:
    assert capped_sum(torch.tensor(ray)).item() == pytest.approx(value, abs=1e-6)


def test_capped_sum_learns_only_from_what_it_kept() -> None:
    p = torch.tensor([0.3, 0.4, 0.9, 0.1], requires_grad=True)
    capped_sum(p).backward()
    assert p.grad is not None and p.grad.tolist() == [1, 1, 0, 0]


def test_absorption() -> None:
    assert absorption(torch.tensor([0.5, 1.0]), density=2).item() == pytest.approx(1 - math.exp(-3))


@settings(deadline=None)
@given(rays)
def test_the_rules_keep_to_their_range_and_agree_on_empty_and_single_rays(ray: torch.Tensor) -> None:
    for rule in (any_occupied, capped_sum, absorption):
        assert -1e-6 <= rule(ray).item() <= 1 + 2e-4
        assert rule(torch.zeros_like(ray)).item() == 0
    assert any_occupied(ray[:1]).item() == pytest.approx(capped_sum(ray[:1]).item(), abs=1e-5)
    assert capped_sum(ray).item() <= ray.sum().item() + 1e-5


@pytest.mark.parametrize("rule", [any_occupied, capped_sum, absorption])
def test_any_dimension(rule) -> None:  # noqa: ANN001
    p = torch.rand(2, 3, 4, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(rule(p, 1), rule(p.transpose(1, 2), -1))


def test_expected_depth_by_hand() -> None:
    """Seen from the camera: 0.5 at w = 0.5 (nearer), then 1 at w = -0.5: 0.5·0.5 + 0.5·1·(-0.5) = 0."""
    x = torch.zeros(1, 2, 2, 2)
    x[0, 0, 0] = torch.tensor([1.0, 0.5])
    x[0, 1, 1] = torch.tensor([0.0, 0.5])
    # The second: 0.5·0.5 - 0.5·1 for the half that reaches the background at -1.
    assert expected_depth(x)[0, 0].tolist() == [[-1, -0.25], [0, -1]]
