"""Sample points: even along both axes and over the square, other ones in every pixel, and repeatable."""

from __future__ import annotations

import torch
from torch import Tensor

from unproject.ops.low_discrepancy import STEPS, offsets, points, seeds

SAMPLES = 64


def drawn(pixels: int = 50, independent: bool = False, seed: float = 0.3) -> Tensor:
    """(pixels, SAMPLES, 2) points of one seed."""
    seed_of_batch, sample = seeds(torch.tensor([seed])), torch.arange(SAMPLES)
    along = [points(offsets(seed_of_batch, pixels, k), sample, k, torch.float64, independent)[0] for k in range(2)]
    return torch.stack(along, -1)


def test_steps_are_powers_of_the_plastic_number() -> None:
    """Roberts' R₂: (1/g, 1/g²) with g³ = g + 1, that is s³ + s² = 1 for s = 1/g."""
    s, square = STEPS
    assert abs(s**3 + s**2 - 1) < 1e-14 and abs(square - s**2) < 1e-14


def test_points_are_even_along_each_axis() -> None:
    """No gap between neighbours on an axis is longer than five mean gaps; random points have longer ones."""

    def longest_gap(x: Tensor) -> float:
        ordered = x.sort(1).values
        return torch.cat([ordered, ordered[:, :1] + 1], 1).diff(dim=1).amax().item()

    assert longest_gap(drawn()) < 5 / SAMPLES < longest_gap(drawn(independent=True))


def test_points_are_even_over_the_square() -> None:
    """The share of points in the boxes [0, a] × [0, b] is nearer to a b than that of random points."""

    def error(x: Tensor) -> float:
        corners = torch.linspace(0.1, 0.9, 9, dtype=torch.float64)
        inside = [((x[..., 0] < a) & (x[..., 1] < b)).double().mean(1) - a * b for a in corners for b in corners]
        return torch.stack(inside).square().mean().sqrt().item()

    assert error(drawn()) < 0.5 * error(drawn(independent=True))


def test_every_pixel_dimension_and_seed_has_its_own_offset() -> None:
    hashed = torch.stack([offsets(seeds(torch.tensor([0.1, 0.2])), 500, k) for k in range(3)])
    assert hashed.unique().numel() == hashed.numel() == 3000
    share = hashed.double() / 2**32
    assert abs(share.mean() - 0.5) < 0.02
    assert torch.corrcoef(share.flatten(0, 1)).triu(1).abs().max() < 0.2
    assert torch.equal(drawn(), drawn()) and not torch.equal(drawn(), drawn(seed=0.31))
