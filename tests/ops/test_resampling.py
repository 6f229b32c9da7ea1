"""Trilinear samples and camera rays by hand."""

from __future__ import annotations

import math

import pytest
import torch

from unproject.ops import camera_frame, orthographic_rays, perspective_rays, sample_volume
from unproject.ops.resampling import centres, depth_range, perspective_slant


def test_centres() -> None:
    assert centres(4, torch.empty(0)).tolist() == [-0.75, -0.25, 0.25, 0.75]


def test_samples_at_voxel_centres_are_the_voxels() -> None:
    x = torch.rand(2, 3, 4, 5, generator=torch.Generator().manual_seed(0))
    points = torch.stack(torch.meshgrid(*(centres(n, x) for n in (3, 4, 5)), indexing="ij"), -1)
    torch.testing.assert_close(sample_volume(x, points.expand(2, 3, 4, 5, 3)), x, atol=1e-6, rtol=0)


def test_between_voxels_it_is_linear_and_outside_it_is_zero() -> None:
    x = torch.zeros(1, 2, 2, 2)
    x[0, 1] = 1
    points = torch.tensor([[(-0.5, 0.5, 0.5), (0, 0.5, 0.5), (0.25, -0.5, 0.5), (1, 0.5, 0.5), (1.6, 0, 0)]])
    assert sample_volume(x, points)[0].tolist() == pytest.approx([0, 0.5, 0.75, 0.5, 0])


def test_parallel_rays_at_azimuth_zero() -> None:
    rays = orthographic_rays(camera_frame(torch.zeros(1)), 2, 1.4, 3, 1.5)
    assert rays.shape == (1, 2, 2, 3, 3)
    assert rays[0, 0, 0, 0].tolist() == pytest.approx([-0.7, 0.7, 1.0])  # top left, nearest
    assert rays[0, 1, 1, 2].tolist() == pytest.approx([0.7, -0.7, -1.0])  # bottom right, farthest


def test_perspective_rays_meet_in_the_pinhole_and_see_the_viewport_in_the_central_plane() -> None:
    frame = camera_frame(torch.tensor([0.7]), torch.tensor([0.3]))
    rays = perspective_rays(frame, 5, 1.2, 3, 1.5, 4.0)
    near, far = rays[0, ..., 0, :], rays[0, ..., 2, :]
    pinhole = near + (near - far) * (4 - 1) / 2
    torch.testing.assert_close(pinhole, (4 * frame[0, 2]).expand_as(pinhole), atol=1e-5, rtol=0)
    flat = orthographic_rays(frame, 5, 1.2, 3, 1.5)
    torch.testing.assert_close(rays[..., 1, :], flat[..., 1, :], atol=1e-6, rtol=0)


def test_the_slant_of_a_pinhole_ray_is_its_length_over_its_depth() -> None:
    """In every pixel, in rows as in columns: sqrt(1 + (0.8² + 0.8²) 0.3²) in the corners of 5 × 5 pixels."""
    frame = camera_frame(torch.tensor([0.7]), torch.tensor([0.3]))
    rays = perspective_rays(frame, 5, 1.2, 3, 1.5, 4.0)[0]
    measured = (rays[..., 0, :] - rays[..., 2, :]).norm(dim=-1) / 2  # the outer of three samples are 2 apart in depth
    slant = perspective_slant(frame, 5, 1.2, 4.0)
    torch.testing.assert_close(slant, measured, atol=1e-6, rtol=0)
    assert slant[0, 4].item() == pytest.approx(math.sqrt(1 + 2 * 0.8**2 * 0.3**2)) and slant[2, 2] == 1


@pytest.mark.parametrize("resolution", [1, 5, 18, 32, 64])
def test_one_sample_a_voxel_on_the_voxel_centres_and_past_the_corners(resolution: int) -> None:
    count, half_depth = depth_range(resolution)
    assert half_depth >= math.sqrt(2) and half_depth / count == pytest.approx(1 / resolution)
    depths = half_depth * centres(count, torch.empty(0))
    inside = depths[depths.abs() < 1]
    torch.testing.assert_close(inside, centres(resolution, depths), atol=1e-6, rtol=0)


def test_a_given_number_of_samples_spans_the_released_depth() -> None:
    assert depth_range(64, 48) == (48, 1.5)
