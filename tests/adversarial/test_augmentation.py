"""Augmentation: what the discriminator sees is shifted, and nothing else."""

from __future__ import annotations

import pytest
import torch

from unproject._types import UserError
from unproject.adversarial.augmentation import Shift, shifted


@pytest.mark.parametrize("shape", [(5, 2, 16), (5, 3, 8, 8)])
def test_a_whole_pixel_is_exact_and_zeros_come_in(shape: tuple[int, ...]) -> None:
    images = torch.rand(shape)
    found = shifted(images, torch.full((5,), 2.0))
    assert torch.equal(found[..., 2:], images[..., :-2]) and not found[..., :2].any()
    assert torch.equal(shifted(images, torch.zeros(5)), images)


def test_between_pixels_it_is_linear() -> None:
    line = torch.tensor([[[0.0, 0.0, 4.0, 0.0, 0.0]]])
    assert shifted(line, torch.tensor([0.25])).tolist() == [[[0.0, 0.0, 3.0, 1.0, 0.0]]]
    assert shifted(line, torch.tensor([-0.25])).tolist() == [[[0.0, 1.0, 3.0, 0.0, 0.0]]]


def test_each_is_shifted_on_its_own_along_every_side() -> None:
    """The centre of mass of a dot moves by the shift; over many, uniformly within the bound."""
    images = torch.zeros(2000, 1, 17, 17)
    images[:, :, 8, 8] = 1
    found = Shift(3.0)(images, torch.Generator().manual_seed(0))[:, 0]
    at = torch.arange(17.0) - 8
    moved = torch.stack([(found.sum(2) * at).sum(1), (found.sum(1) * at).sum(1)])
    assert moved.abs().max() <= 3 and torch.corrcoef(moved)[0, 1].abs() < 0.1
    assert (moved.mean(1).abs() < 0.15).all() and ((moved.var(1) - 3).abs() < 0.3).all()  # (2 · 3)² / 12


def test_gradients_are_those_of_a_shift_back() -> None:
    images = torch.rand(3, 1, 9, dtype=torch.float64, requires_grad=True)
    by = torch.tensor([0.3, -1.7, 4.0], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda x: shifted(x, by), images)


@pytest.mark.parametrize("pixels", [0.0, -1.0, float("inf"), float("nan")])
def test_a_shift_is_positive(pixels: float) -> None:
    with pytest.raises(UserError, match="shift="):
        Shift(pixels)
