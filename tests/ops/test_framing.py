"""Framing: one picture for every size and place, by the rule of the readers, and gradients that do not resize."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor
from torch.nn import functional

from unproject._random import generator_at
from unproject.data import Collection, birds, cars, chairs, observe
from unproject.data.readers.framing import Framing, frame
from unproject.ops import bounding_box, common_fill, common_height, framed, framing, unit_sized
from unproject.projections.silhouette import Silhouette, azimuth_bins

WIDTH = 40


def covered(low: float, high: float) -> Tensor:
    """The share of each of 40 pixels that an interval covers."""
    pixels = torch.arange(WIDTH, dtype=torch.float64)
    return ((pixels + 1).clamp(max=high) - pixels.clamp(min=low)).clamp(min=0)


def boot(side: float, row: float, column: float) -> Tensor:
    """A picture (1, 1, 40, 40), anti-aliased, of an L of this width with its upper left corner there; 0.75 as high."""
    leg = torch.outer(covered(row, row + 0.45 * side), covered(column, column + 0.3 * side))
    foot = torch.outer(covered(row + 0.45 * side, row + 0.75 * side), covered(column, column + side))
    return (leg + foot)[None, None]


# Boxes


@pytest.mark.parametrize("row, column", [(6.0, 9.0), (6.5, 9.25), (5.85, 9.6)])
def test_boxes_are_found_between_pixels(row: float, column: float) -> None:
    box = bounding_box(boot(20, row, column))
    found = torch.cat(list(box))
    torch.testing.assert_close(found, torch.tensor([row, row + 15, column, column + 20]).double(), atol=0.15, rtol=0)
    assert box.longer.item() == pytest.approx(20, abs=0.2)


def test_a_box_is_where_half_of_the_maximum_is_reached() -> None:
    faint = 0.2 * boot(20, 6, 9) + 0.05
    assert torch.cat(list(bounding_box(faint))).tolist() == pytest.approx([6, 21, 9, 29], abs=0.3)
    assert [edge.item() for edge in bounding_box(torch.zeros(1, 1, 6, 9))] == [0, 6, 0, 9]


@pytest.mark.parametrize("cover", [0.13, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("end", [30.0, 30.5])
def test_a_leg_that_covers_a_part_of_each_pixel_belongs_to_the_box(cover: float, end: float) -> None:
    table = torch.outer(covered(5, 9), covered(4, 34))
    leg = torch.outer(covered(9, end), cover * covered(10, 11))
    box = bounding_box((table + leg)[None, None], thin=True)
    assert [edge.item() for edge in box] == pytest.approx([5, end, 4, 34], abs=0.6)
    plain = bounding_box((table + leg)[None, None])
    assert plain.bottom.item() == pytest.approx(end if cover > 0.5 else 9, abs=0.7)


def test_boxes_with_thin_parts_are_those_of_thick_ones_and_leave_haze_out() -> None:
    for row in (6.0, 6.5, 6.9):
        plain, thin = (bounding_box(boot(20, row, 9.25), thin=thin) for thin in (False, True))
        torch.testing.assert_close(torch.cat(list(thin)), torch.cat(list(plain)), atol=0.06, rtol=0)
    hazy = bounding_box(0.2 * boot(20, 6, 9) + 0.01, thin=True)
    assert torch.cat(list(hazy)).tolist() == pytest.approx([6, 21, 9, 29], abs=0.3)
    assert [edge.item() for edge in bounding_box(torch.zeros(1, 1, 6, 9), thin=True)] == [0, 6, 0, 9]


# One picture of every size and place


@pytest.mark.parametrize("side", [12.0, 17.3, 25.0, 33.9])
@pytest.mark.parametrize("row, column", [(2.0, 3.0), (5.4, 0.7), (9.25, 5.5)])
def test_size_and_place_do_not_matter(side: float, row: float, column: float) -> None:
    reference = framed(boot(36, 2, 2), 12, height=0.75)
    found = framed(boot(side, row, column), 12, height=0.75)
    assert (found - reference).abs().mean() < 0.02 and (found - reference).abs().max() < 0.3
    assert reference.mean().item() == pytest.approx(0.75**2 * (0.45 * 0.3 + 0.3), abs=0.01)


@pytest.mark.parametrize("shape", [(24, 24), (17, 40), (50, 21)])
@pytest.mark.parametrize("size, fill", [(16, 0.85), (9, 0.6), (32, 1.0)])
def test_binary_pictures_are_framed_as_the_readers_do(shape: tuple[int, int], size: int, fill: float) -> None:
    """The same box, square and areas, of blots with holes that may touch one side of the picture."""
    for seed in range(4):
        coarse = torch.rand(1, 1, 6, 7, generator=generator_at(seed))
        picture = (functional.interpolate(coarse, size=shape, mode="bilinear") > 0.55).float()
        picture[..., : seed * 2, :] = 0
        expected = frame(picture[0, 0].numpy(), size, Framing(fill=fill, polarity="light", min_pixels=1)).image
        torch.testing.assert_close(framed(picture, size, fill)[0], expected, atol=2e-5, rtol=0)


@pytest.mark.parametrize("fill", [0.75, 1.0])
def test_framing_twice_is_framing_once(fill: float) -> None:
    once = framed(boot(26.3, 3.2, 8.1), 24, fill)
    twice = framed(once, 24, fill)
    assert (twice - once).abs().mean() < 0.015 and (twice - once).abs().max() < 0.3
    assert framing.bounding_box(once).longer.item() == pytest.approx(24 * fill, abs=0.35)


def test_each_picture_is_framed_alone_and_in_its_precision() -> None:
    pictures = torch.cat([boot(12, 20, 3), boot(30, 2, 4), torch.zeros(1, 1, 40, 40), boot(21.5, 8.2, 16)])
    together = framed(pictures, 16)
    alone = torch.cat([framed(picture[None], 16) for picture in pictures])
    assert together.dtype == torch.float64 and framed(pictures.float(), 16).dtype == torch.float32
    torch.testing.assert_close(together, alone, atol=1e-12, rtol=0)
    torch.testing.assert_close(framed(pictures.float(), 16).double(), together, atol=1e-5, rtol=0)


@pytest.mark.parametrize("value", [0.0, 1e-20, 1e-7, 1.0])
def test_even_pictures_and_their_gradients_are_finite(value: float) -> None:
    picture = torch.full((2, 1, 12, 12), value, requires_grad=True)
    y = framed(picture, 8)
    (gradient,) = torch.autograd.grad(y.sum(), picture)
    assert y.isfinite().all() and gradient.isfinite().all()
    assert y.max().item() == pytest.approx(value, abs=1e-6)


# Gradients


def test_the_box_is_a_constant_for_gradients(monkeypatch: pytest.MonkeyPatch) -> None:
    """The derivative is that of the resampling alone, in any direction that a finite difference is taken in."""
    picture = boot(21.3, 6.2, 9.1).requires_grad_()
    direction = torch.randn(picture.shape, generator=generator_at(0), dtype=torch.float64)
    weights = torch.randn(1, 1, 12, 12, generator=generator_at(1), dtype=torch.float64)
    (gradient,) = torch.autograd.grad((framed(picture, 12) * weights).sum(), picture)
    box = bounding_box(picture)
    monkeypatch.setattr(framing, "bounding_box", lambda _, thin=False: box)
    up, down = (framed(picture.detach() + step * direction, 12) for step in (1e-6, -1e-6))
    inside = (up > 0) & (down > 0) & (up < 1) & (down < 1)  # elsewhere the result is clamped
    weights = weights * inside
    (gradient,) = torch.autograd.grad((framed(picture, 12) * weights).sum(), picture)
    assert ((up - down) * weights).sum().item() / 2e-6 == pytest.approx((gradient * direction).sum().item(), rel=1e-5)


# One height


@pytest.mark.parametrize("height", [0.3, 0.4])
def test_pictures_get_one_height_unless_they_are_too_wide(height: float) -> None:
    pictures = torch.zeros(3, 1, 40, 40)
    pictures[0, :, 10:30, 15:25], pictures[1, :, 2:6, 30:38], pictures[2, :, 20:24, 1:39] = 1, 1, 1
    box = bounding_box(framed(pictures, 40, height, 0.9))
    assert box.height[:2].tolist() == pytest.approx([40 * height] * 2, abs=0.3)
    assert box.width.tolist() == pytest.approx([20 * height, 80 * height, 36], abs=0.5)
    assert box.height[2].item() == pytest.approx(36 * 4 / 38, abs=0.5)


@pytest.mark.parametrize("aspect, height", [(0.5, 0.85), (1.5, 0.6), (3.0, 0.3), (10.0, 0.2)])
def test_the_common_height_leaves_nine_in_ten_whole(aspect: float, height: float) -> None:
    pictures = torch.zeros(40, 1, 64, 64)
    tall = round(24 / max(aspect, 1))
    pictures[..., 8 : 8 + tall, 4 : 4 + round(tall * aspect)] = 1
    pictures[:3, :, 30:32, 4:60] = 1  # a few much wider ones
    pictures[:3, :, :30] = 0
    assert common_height(pictures) == pytest.approx(height, rel=0.1)


# Which collections were cropped


def seen(volumes: Tensor) -> Tensor:
    """Silhouettes of them from eight sides, 32 pixels wide."""
    return observe(Collection(volumes), azimuth_bins(8, Silhouette(size=32)), 4).floats()


PROCEDURAL = {"chairs": chairs, "cars": cars, "birds": birds}


@pytest.mark.parametrize("name", PROCEDURAL)
def test_pictures_that_were_cropped_are_known_by_their_size(name: str) -> None:
    whole = seen(PROCEDURAL[name](12, 32, seed=1))
    assert common_fill(whole) is None and common_fill((whole > 0.5).float()) is None
    for size, fill in ((32, 0.85), (24, 0.6), (64, 0.95)):
        cropped = framed(whole, size, fill)
        assert common_fill(cropped) == pytest.approx(fill, abs=1 / size)
        assert common_fill((cropped > 0.5).float()) == pytest.approx(fill, abs=1.5 / size)


def test_one_in_twenty_may_be_something_else() -> None:
    cropped = framed(boot(20, 4, 4), 32, 0.75).repeat(40, 1, 1, 1)
    other = torch.zeros(1, 32, 32)
    other[:, 2:9, 3:8] = 1
    cropped[:2] = other
    assert common_fill(cropped) == pytest.approx(0.75, abs=0.03)
    cropped[2] = other
    assert common_fill(cropped) is None


def test_equally_long_ones_that_are_not_centred_were_not_cropped() -> None:
    centred = framed(boot(20, 4, 4), 32, 0.75).repeat(40, 1, 1, 1)
    assert common_fill(centred.roll(3, -1)) is None and common_fill(centred.roll(-3, -2)) is None
    assert common_fill(centred[..., 2:-2, :]) is None


def test_silhouettes_of_half_precision_are_framed_in_single() -> None:
    half = boot(20, 4, 4).bfloat16()
    assert torch.equal(framed(half, 32), framed(half.float(), 32))


# Volumes


@pytest.mark.parametrize("low, sides", [((1, 2, 3), (6, 12, 6)), ((4, 0, 9), (20, 5, 10)), ((9, 9, 9), (4, 4, 2))])
def test_volumes_are_brought_to_one_size(low: tuple[int, int, int], sides: tuple[int, int, int]) -> None:
    x = torch.zeros(2, 24, 24, 24)
    x[0][tuple(slice(a, a + n) for a, n in zip(low, sides, strict=True))] = 1
    found = unit_sized(x, side=0.75)
    assert torch.equal(found[1], x[1])
    occupied = (found[0] > 0.5).nonzero()
    first, last = occupied.amin(0), occupied.amax(0) + 1
    assert (first + last - 24).abs().max() <= 1
    expected = torch.tensor(sides) * 18 / max(sides)
    assert (last - first - expected).abs().max() <= 1


def test_one_shape_of_two_sizes_becomes_one() -> None:
    small, large = torch.zeros(2, 24, 24, 24)
    small[2:8, 1:9, 4:8], small[2:8, 1:5, 4:14] = 1, 1
    large[4:16, 5:21, 2:10], large[4:16, 5:13, 2:22] = 1, 1
    a, b = (unit_sized(torch.stack([small, large])) > 0.5).unbind()
    assert (a & b).sum() / (a | b).sum() > 0.9
