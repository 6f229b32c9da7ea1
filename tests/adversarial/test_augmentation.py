"""Augmentation: what the discriminator sees is shifted, and nothing else."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject._types import UserError
from unproject.adversarial.augmentation import Affine, Augmentation, Shift, Sometimes, moved, shifted
from unproject.ops import rotate_image


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


def still(images: Tensor, **changed: Tensor) -> Tensor:
    """`moved` by nothing but what is given."""
    none = torch.zeros(len(images)).to(images)
    return moved(images, **{"by": torch.stack([none, none], 1), "zoom": none + 1, "roll": none, **changed})


def test_moving_by_nothing_or_by_whole_pixels_is_exact() -> None:
    images = torch.rand(3, 2, 16, 8, dtype=torch.float64)
    assert torch.allclose(still(images), images, atol=1e-12)
    found = still(images, by=torch.tensor([[2 / 8, 3 / 16]], dtype=torch.float64).expand(3, 2))  # to the right, down
    assert torch.allclose(found[:, :, 3:, 2:], images[:, :, :-3, :-2], atol=1e-12)
    assert not found[:, :, :3].any() and not found[:, :, :, :2].any()


def test_a_roll_is_a_rotation_and_a_zoom_enlarges() -> None:
    images, roll = torch.rand(3, 1, 16, 8), torch.tensor([0.3, -0.2, math.pi / 2])
    assert torch.allclose(still(images, roll=roll), rotate_image(images, roll), atol=1e-5)
    square = torch.zeros(2, 1, 32, 32)
    square[:, :, 12:20, 12:20] = 1
    large, small = still(square, zoom=torch.tensor([2.0, 0.5])).sum((1, 2, 3)).tolist()
    assert large == pytest.approx(4 * 64, rel=0.05) and small == pytest.approx(64 / 4, rel=0.05)


def test_a_roll_and_a_zoom_come_before_the_shift() -> None:
    """The object turns about the centre of the picture and then moves: otherwise a shift would be zoomed."""
    images = torch.rand(1, 1, 16, 16, dtype=torch.float64)
    by, zoom, roll = (torch.tensor(v, dtype=torch.float64) for v in ([[0.25, 0.0]], [1.3], [0.4]))
    turned = still(images, zoom=zoom, roll=roll)
    assert torch.allclose(moved(images, by, zoom, roll)[..., 4:], turned[..., :-4], atol=1e-12)


def test_each_picture_is_moved_on_its_own_within_the_ranges() -> None:
    """Of a small blob off the centre: where it is, how large, and at which angle."""
    images = torch.zeros(4000, 1, 64, 64)
    images[:, :, 30:34, 42:46] = 1
    found = Affine(shift=0.1, zoom=0.2, roll=0.2)(images, torch.Generator().manual_seed(0))[:, 0]
    at = torch.arange(64.0) - 31.5
    area = found.sum((1, 2))
    right, down = (found.sum(1) * at).sum(1) / area, (found.sum(2) * at).sum(1) / area
    zoom = (area / 16).sqrt()
    assert (zoom > 0.8).all() and (zoom < 1.23).all() and zoom.log().mean().abs() < 0.02 and zoom.std() > 0.08
    within = 0.1 * 64 + 12 * 1.2 * 0.2  # shifted, and rolled at a distance of 12
    assert down.abs().max() <= within + 0.3 and down.mean().abs() < 0.3
    assert down.std() == pytest.approx(((6.4**2 + (12 * 0.2) ** 2) / 3) ** 0.5, rel=0.05)
    assert right.std() == pytest.approx(((6.4**2 + (12 * math.log(1.2)) ** 2) / 3) ** 0.5, rel=0.05)
    assert torch.corrcoef(torch.stack([right, down]))[0, 1].abs() < 0.1


@pytest.mark.parametrize("augmentation", [Affine(), Sometimes(Affine(), 0.7), Shift(1.5)], ids=repr)
def test_augmented_images_are_linear_in_the_image(augmentation: Augmentation) -> None:
    """Values and gradients: the same draw again by the same generator."""

    def transformed(x: Tensor) -> Tensor:
        return augmentation(x, torch.Generator().manual_seed(3))

    images = torch.rand(3, 1, 5, 6, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(transformed, images)
    assert torch.allclose(transformed(2 * images + 1), 2 * transformed(images) + transformed(torch.ones_like(images)))


@pytest.mark.parametrize("strength", [0.0, 0.3, 1.0])
def test_the_strength_is_the_share_of_images_that_are_augmented(strength: float) -> None:
    """The others stay bit for bit."""
    images = torch.rand(3000, 1, 8, 8)
    found = Sometimes(Affine(), strength)(images, torch.Generator().manual_seed(0))
    changed = (found != images).flatten(1).any(1).float().mean().item()
    assert changed == pytest.approx(strength, abs=0.03)


@pytest.mark.parametrize("shift, zoom, roll", [(-0.1, 0.1, 0.1), (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 9.0)])
def test_ranges_are_parts_and_not_all_none(shift: float, zoom: float, roll: float) -> None:
    with pytest.raises(UserError, match="give ranges of 0 to 1"):
        Affine(shift, zoom, roll)


def test_only_pictures_are_moved_and_a_strength_is_a_probability() -> None:
    with pytest.raises(UserError, match=r"pictures \(C, H, W\), not items of shape \(1, 8\); use Shift"):
        Affine()(torch.zeros(2, 1, 8), torch.Generator())
    with pytest.raises(UserError, match="strength=1.5: give 0 to 1"):
        Sometimes(Shift(1.0), 1.5)
