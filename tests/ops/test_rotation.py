"""Frames and turns: axes and directions by hand, quarter turns as permutations."""

from __future__ import annotations

import math
from itertools import product

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from unproject.ops import camera_frame, quarter_turn, reflect_x, rotate, rotate_image, rotate_y
from unproject.ops.resampling import centres

QUARTER = math.pi / 2
angles = st.floats(-10, 10, allow_nan=False)


def random_volume(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


def blob(centre: tuple[float, float, float], size: int = 24) -> torch.Tensor:
    """(1, N, N, N) a small Gaussian: smooth, so that resampling hardly moves it."""
    axes = torch.meshgrid(*[centres(size, torch.empty(0))] * 3, indexing="ij")
    distance = torch.stack([a - c for a, c in zip(axes, centre)]).norm(dim=0)
    return torch.exp(-((distance / 0.15) ** 2) / 2)[None]


def centroid(x: torch.Tensor) -> list[float]:
    axes = torch.meshgrid(*(centres(n, x) for n in x.shape[1:]), indexing="ij")
    return [float((x[0] * axis).sum() / x.sum()) for axis in axes]


@settings(deadline=None)
@given(angles, st.floats(-1.5, 1.5))
def test_the_frame_is_right_handed_and_stands_where_the_conventions_say(azimuth: float, elevation: float) -> None:
    a, e = torch.tensor([azimuth], dtype=torch.float64), torch.tensor([elevation], dtype=torch.float64)
    r, u, d = camera_frame(a, e)[0]
    ca, sa, ce, se = math.cos(azimuth), math.sin(azimuth), math.cos(elevation), math.sin(elevation)
    torch.testing.assert_close(d, torch.tensor([sa * ce, se, ca * ce], dtype=torch.float64), atol=1e-5, rtol=0)
    torch.testing.assert_close(r, torch.tensor([ca, 0, -sa], dtype=torch.float64), atol=1e-5, rtol=0)
    torch.testing.assert_close(torch.linalg.cross(r, u), d, atol=1e-5, rtol=0)
    torch.testing.assert_close(torch.linalg.cross(d, r), u, atol=1e-5, rtol=0)


@pytest.mark.parametrize("size", [4, 7, 16])
@pytest.mark.parametrize("k", range(-5, 6))
def test_quarter_turns_about_the_up_axis_are_permutations(k: int, size: int) -> None:
    x = random_volume(2, size, size + 1, size)
    azimuth = torch.full((2,), k * QUARTER)
    torch.testing.assert_close(rotate_y(x, azimuth), quarter_turn(x, k), atol=1e-6, rtol=0)
    torch.testing.assert_close(rotate(x, azimuth, torch.zeros(2)), quarter_turn(x, k), atol=1e-6, rtol=0)


@pytest.mark.parametrize("k, tilt", list(product(range(4), (-1, 1))))
def test_quarter_turns_about_the_other_axes_are_permutations(k: int, tilt: int) -> None:
    x = random_volume(1, 8, 8, 8)
    out = rotate(x, torch.tensor([k * QUARTER]), torch.tensor([tilt * QUARTER]))
    # From the top (tilt = 1) the far side -z of the turned object is at the top of the picture: (v, w) = (-z, y).
    turned = quarter_turn(x, k).transpose(2, 3)
    expected = turned.flip(2) if tilt == 1 else turned.flip(3)
    torch.testing.assert_close(out, expected, atol=1e-6, rtol=0)


def test_quarter_turn_by_hand() -> None:
    """From azimuth 90° the camera stands at +x: +x comes nearest (w = 1) and +z goes to the picture's left."""
    x = torch.zeros(1, 3, 3, 3)
    x[0, 2, 1, 1], x[0, 1, 1, 2] = 1, 2
    out = quarter_turn(x, 1)
    assert out[0, 1, 1, 2] == 1 and out[0, 0, 1, 1] == 2


@pytest.mark.parametrize(
    "degrees, expected", [(0, (0.5, 0, 0)), (90, (0, 0, 0.5)), (180, (-0.5, 0, 0)), (270, (0, 0, -0.5))]
)
def test_where_plus_x_goes(degrees: int, expected: tuple[float, float, float]) -> None:
    out = rotate_y(blob((0.5, 0, 0)), torch.tensor([math.radians(degrees)]))
    assert centroid(out) == pytest.approx(expected, abs=2e-3)


@settings(deadline=None, max_examples=20)
@given(angles, st.floats(-1.5, 1.5))
def test_a_point_lands_at_its_camera_coordinates(azimuth: float, elevation: float) -> None:
    point = (0.3, 0.2, -0.25)
    a, e = torch.tensor([azimuth]), torch.tensor([elevation])
    expected = (camera_frame(a, e)[0] @ torch.tensor(point)).tolist()
    assert centroid(rotate(blob(point), a, e)) == pytest.approx(expected, abs=5e-3)


def test_rotate_without_elevation_is_rotate_y() -> None:
    x, azimuth = random_volume(3, 6, 5, 6), torch.tensor([0.3, 2.0, -4.0])
    torch.testing.assert_close(rotate(x, azimuth), rotate(x, azimuth, torch.zeros(3)), atol=1e-5, rtol=0)


def test_turning_there_and_back_keeps_a_smooth_volume() -> None:
    x, azimuth = blob((0.2, 0.1, 0.3)), torch.tensor([0.7])
    assert (rotate_y(rotate_y(x, azimuth), -azimuth) - x).abs().max() < 0.1


def test_outside_is_empty() -> None:
    out = rotate_y(torch.ones(1, 16, 4, 16), torch.tensor([math.pi / 4]))
    assert out[0, 0, :, 0].abs().max() == 0 and out[0, 8, :, 8].min() == pytest.approx(1)


@pytest.mark.parametrize("angles", [(0.3, None), (0.3, 0.4)])
def test_differentiable_in_the_volume_and_the_angles(angles: tuple[float, float | None]) -> None:
    x = random_volume(1, 4, 4, 4).double().requires_grad_()
    latents = tuple(torch.tensor([a], dtype=torch.float64, requires_grad=True) for a in angles if a is not None)
    assert torch.autograd.gradcheck(rotate, (x, *latents))


def test_gradient_in_the_azimuth_at_a_quarter_turn() -> None:
    """Exactness must not cost the derivative: a quarter turn is not a stationary point."""
    azimuth = torch.tensor([QUARTER], requires_grad=True)
    camera_frame(azimuth)[0, 0, 0].backward()
    assert azimuth.grad is not None and azimuth.grad.item() == pytest.approx(-1)


def test_reflection_is_an_involution_that_reverses_turns() -> None:
    x, azimuth = random_volume(1, 6, 6, 6), torch.tensor([0.4])
    assert torch.equal(reflect_x(reflect_x(x)), x)
    torch.testing.assert_close(rotate_y(reflect_x(x), azimuth), reflect_x(rotate_y(x, -azimuth)), atol=1e-5, rtol=0)


@pytest.mark.parametrize("shape", [(6, 6), (5, 5)])
def test_images_turn_counter_clockwise(shape: tuple[int, int]) -> None:
    x = random_volume(2, 3, *shape)
    for k in range(4):
        turned = rotate_image(x, torch.full((2,), k * QUARTER))
        torch.testing.assert_close(turned, torch.rot90(x, k, (2, 3)), atol=1e-5, rtol=0)


def test_pixels_of_oblong_images_are_square() -> None:
    """A square in the middle of a wide image stays a square."""
    x = torch.zeros(1, 1, 8, 16)
    x[..., 2:6, 6:10] = 1
    torch.testing.assert_close(rotate_image(x, torch.tensor([QUARTER])), x, atol=1e-5, rtol=0)


@pytest.mark.parametrize("kind", [torch.bfloat16, torch.float16])
@pytest.mark.parametrize("turned", [rotate_y, lambda x, angle: rotate(x, angle, angle / 2)])
def test_volumes_of_half_precision_are_turned_by_the_whole_angle(kind: torch.dtype, turned) -> None:
    x, angle = random_volume(2, 16, 16, 16).to(kind), torch.tensor([0.05, 6.1])
    assert torch.equal(turned(x, angle), turned(x.float(), angle))


def test_images_of_half_precision_are_turned_by_the_whole_angle() -> None:
    x, angle = random_volume(2, 1, 16, 16).bfloat16(), torch.tensor([0.05, 6.1])
    assert torch.equal(rotate_image(x, angle), rotate_image(x.float(), angle))
