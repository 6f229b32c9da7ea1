"""Refinement: averages are kept, lines and parabolas reproduced, reflections commute."""

from __future__ import annotations

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from unproject.ops import refined

TIMES = (1, 2, 3, 4, 5)


def averages(x: Tensor, times: int) -> Tensor:
    return x.unflatten(-1, (-1, times)).mean(-1)


def random(*shape: int) -> Tensor:
    return torch.randn(*shape, dtype=torch.float64, generator=torch.Generator().manual_seed(0))


@pytest.mark.parametrize("times", TIMES)
@pytest.mark.parametrize("count", [1, 2, 9])
def test_averages_are_kept(times: int, count: int) -> None:
    x = random(3, count)
    fine = refined(x, times, -1)
    assert fine.shape == (3, count * times)
    torch.testing.assert_close(averages(fine, times), x, rtol=0, atol=1e-14)


@pytest.mark.parametrize("times, curvature", [(2, 0.0), (2, 3.0), (3, 0.0), (4, 0.0), (5, 0.0)])
def test_lines_are_reproduced_and_by_halves_quadratics(times: int, curvature: float) -> None:
    """Averages over cells of c t² - t + 2, whose integral is c t³ / 3 - t² / 2 + 2 t."""

    def cells(edges: Tensor) -> Tensor:
        integral = curvature * edges**3 / 3 - edges**2 / 2 + 2 * edges
        return integral.diff() / edges.diff()

    coarse = cells(torch.linspace(0, 7, 8, dtype=torch.float64))
    fine = cells(torch.linspace(0, 7, 7 * times + 1, dtype=torch.float64))
    inside = slice(times, -times)
    torch.testing.assert_close(refined(coarse, times, 0)[inside], fine[inside])


@pytest.mark.parametrize("times", TIMES)
def test_what_is_reflected_at_an_end_is_refined_as_its_half(times: int) -> None:
    half = random(2, 6)
    fine = refined(half, times, 1)
    whole = refined(torch.cat([half, half.flip(1)], 1), times, 1)
    torch.testing.assert_close(torch.cat([fine, fine.flip(1)], 1), whole)


@pytest.mark.parametrize("axis", [0, 1, 2, -1, -3])
def test_along_any_axis(axis: int) -> None:
    x = random(3, 4, 5)
    expected = refined(x.movedim(axis, -1), 2, -1).movedim(-1, axis)
    torch.testing.assert_close(refined(x, 2, axis), expected)


def test_once_as_fine_is_the_same_tensor() -> None:
    x = random(3, 4)
    assert refined(x, 1, 0) is x


def test_closer_than_repeating_or_interpolating_linearly() -> None:
    """A sine of 8 cells a period: errors of 0.21 and 0.35 of those of repeated values."""
    edges = torch.linspace(0, 64, 513, dtype=torch.float64)
    exact = -(2 * torch.pi * edges / 8).cos().diff()
    coarse = averages(exact, 8)

    def error(found: Tensor) -> Tensor:
        return (found - exact)[16:-16].square().mean().sqrt()

    linear = F.interpolate(coarse[None, None], scale_factor=8, mode="linear")[0, 0]
    assert error(refined(coarse, 8, 0)) < 0.25 * error(coarse.repeat_interleave(8)) < error(linear)
