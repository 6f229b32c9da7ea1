"""Line integrals: exact on rectangles, right on discs, and the sparse and native paths equal to the plain reference."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.ops.line_integrals import strip_integrals, strip_integrals_native, strip_integrals_sparse
from unproject.projections import LineIntegral

ANGLES = torch.tensor([0, 0.02, 0.6, math.pi / 4, 1.2, math.pi / 2, 2.5, math.pi, 4.0, -0.3], dtype=torch.float64)
FAST = pytest.mark.parametrize("integrals", [strip_integrals_sparse, strip_integrals_native])
ALL = pytest.mark.parametrize("integrals", [strip_integrals, strip_integrals_sparse, strip_integrals_native])


def edges(bins: int) -> Tensor:
    return torch.arange(bins + 1, dtype=torch.float64) / bins - 0.5


def rectangle_measured(bins: int, low: tuple[float, float], high: tuple[float, float]) -> Tensor:
    """(angles, bins), by clipping: the area of a rectangle on one side of a line, from its corners."""
    corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    areas = [[area_below(corners, a, float(u)) for u in edges(bins)] for a in ANGLES.tolist()]
    return torch.tensor(areas, dtype=torch.float64).diff(dim=1) * bins


def area_below(corners: list[tuple[float, float]], angle: float, limit: float) -> float:
    """Of a polygon, cut at x cos + y sin = limit (Sutherland-Hodgman), by the shoelace formula."""
    kept = []
    distance = [x * math.cos(angle) + y * math.sin(angle) - limit for x, y in corners]
    for k, ((x, y), d) in enumerate(zip(corners, distance, strict=True)):
        (x1, y1), d1 = corners[k - 1], distance[k - 1]
        if (d <= 0) != (d1 <= 0):
            t = d1 / (d1 - d)
            kept.append((x1 + t * (x - x1), y1 + t * (y - y1)))
        if d <= 0:
            kept.append((x, y))
    return abs(sum(kept[k - 1][0] * y - kept[k - 1][1] * x for k, (x, y) in enumerate(kept))) / 2


@ALL
@pytest.mark.parametrize("bins", [7, 16, 40])
def test_rectangles_of_pixels_are_exact_at_any_angle(integrals, bins):  # type: ignore[no-untyped-def]
    # Columns 3..9 and rows 2..5 of 16: x from 3/16 - 1/2 to 10/16 - 1/2, y from 1/2 - 6/16 to 1/2 - 2/16.
    image = torch.zeros(1, 1, 16, 16, dtype=torch.float64)
    image[..., 2:6, 3:10] = 1
    expected = rectangle_measured(bins, (3 / 16 - 0.5, 0.5 - 6 / 16), (10 / 16 - 0.5, 0.5 - 2 / 16))
    y = integrals(image.expand(len(ANGLES), -1, -1, -1), ANGLES, bins)[:, 0]
    torch.testing.assert_close(y, expected, rtol=0, atol=1e-12)


@ALL
@pytest.mark.parametrize("centre", [(0.0, 0.0), (0.11, -0.07)])
def test_a_disc_is_within_half_a_percent(integrals, centre):  # type: ignore[no-untyped-def]
    """∫ 2 √(r² - u²) du over a detector, of a disc drawn with 16² samples a pixel.

    The rim, where the profile is infinitely steep, is blurred by the pixels: one a detector are enough inside it,
    four a detector on it.
    """
    size, radius, fine = 128, 0.3, 16
    place = (torch.arange(size * fine, dtype=torch.float64) + 0.5) / (size * fine) - 0.5
    inside = ((place - centre[0]).square() + (-place[:, None] - centre[1]).square() < radius**2).double()
    image = torch.nn.functional.avg_pool2d(inside[None, None], fine)
    middle = centre[0] * ANGLES.cos() + centre[1] * ANGLES.sin()
    for bins in (size, size // 4):
        y = integrals(image.expand(len(ANGLES), -1, -1, -1), ANGLES, bins)[:, 0]
        u = edges(bins) - middle[:, None]
        inside = u.clamp(-radius, radius)
        expected = (inside * (radius**2 - inside**2).sqrt() + radius**2 * (inside / radius).asin()).diff(dim=1) * bins
        away = (u.abs() - radius).abs() > 2 / size
        counted = (away[:, 1:] & away[:, :-1]) | (bins < size)
        assert ((y - expected).abs() * counted).max() < 0.005 * 2 * radius, bins


@ALL
def test_directions_along_the_axes(integrals):  # type: ignore[no-untyped-def]
    image = torch.rand(1, 2, 6, 6, generator=generator_at(0))
    turns = torch.tensor([0, 0.5, 1, 1.5]) * math.pi
    columns, rows = image[0].mean(1), image[0].mean(2).flip(1)  # left to right, bottom to top
    y = integrals(image.expand(4, -1, -1, -1), turns, 6)
    torch.testing.assert_close(y, torch.stack([columns, rows, columns.flip(1), rows.flip(1)]), rtol=0, atol=1e-6)


@FAST
@pytest.mark.parametrize(
    "shape, bins", [((8, 8), 8), ((8, 8), 3), ((8, 8), 29), ((5, 12), 12), ((12, 5), 7), ((1, 1), 4)]
)
def test_the_fast_paths_equal_the_reference(integrals, shape, bins):  # type: ignore[no-untyped-def]
    rng = generator_at(1)
    for dtype, tolerance in ((torch.float64, 1e-12), (torch.float32, 2e-6)):
        image = torch.rand(len(ANGLES), 2, *shape, generator=rng).to(dtype).requires_grad_()
        angle = ANGLES.to(dtype)
        y, expected = integrals(image, angle, bins), strip_integrals(image, angle, bins)
        torch.testing.assert_close(y, expected, rtol=0, atol=tolerance * bins)
        weight = torch.rand(y.shape, generator=rng).to(dtype)
        ours, theirs = (torch.autograd.grad(value, image, weight)[0] for value in (y, expected))
        torch.testing.assert_close(ours, theirs, rtol=0, atol=tolerance * bins)


@ALL
def test_adjoint(integrals):  # type: ignore[no-untyped-def]
    image = torch.rand(len(ANGLES), 1, 32, 32, dtype=torch.float64, generator=generator_at(2)).requires_grad_()
    y = integrals(image, ANGLES, 32)
    weight = torch.rand(y.shape, dtype=torch.float64, generator=generator_at(3))
    (back,) = torch.autograd.grad(y, image, weight)
    assert abs((y * weight).sum() - (image * back).sum()) < 1e-10


@FAST
def test_the_fast_paths_differentiate_twice(integrals):  # type: ignore[no-untyped-def]
    image = torch.rand(2, 1, 3, 3, dtype=torch.float64, generator=generator_at(4)).requires_grad_()
    assert torch.autograd.gradgradcheck(lambda x: integrals(x, ANGLES[1:3], 4), image)


def test_the_reference_differentiates_in_the_angle() -> None:
    image = torch.rand(3, 1, 4, 4, dtype=torch.float64, generator=generator_at(5))
    assert torch.autograd.gradcheck(lambda a: strip_integrals(image, a, 5), ANGLES[1:4].clone().requires_grad_())


@FAST
def test_all_that_falls_on_wide_enough_detectors_is_measured(integrals):  # type: ignore[no-untyped-def]
    image = torch.rand(len(ANGLES), 1, 8, 8, dtype=torch.float64, generator=generator_at(6))
    image = torch.nn.functional.pad(image, (2, 2, 2, 2))  # its corners within the detectors at any angle
    y = integrals(image, ANGLES, 12)
    torch.testing.assert_close(y.mean(2), image.mean((2, 3)), rtol=0, atol=1e-12)


@ALL
def test_an_angle_that_is_none_gives_no_value_and_harms_no_other(integrals):  # type: ignore[no-untyped-def]
    """A wild place in memory, if it went unnoticed."""
    image = torch.rand(3, 2, 16, 16, requires_grad=True)
    angle = torch.tensor([0.3, math.nan, 0.3])
    y = integrals(image, angle, 16)
    assert y[1].isnan().all() and y[0].isfinite().all() and y[2].isfinite().all()


@pytest.mark.parametrize("size", [(0, 8), (8, 0)])
def test_an_image_without_pixels_is_refused(size: tuple[int, int]) -> None:
    with pytest.raises(UserError, match="has no pixel"):
        LineIntegral()(torch.rand(1, 1, *size), angle=torch.zeros(1))
