"""Iso-surfaces: closed, outwards, in the frame of the volume."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import trimesh

from unproject._types import UserError
from unproject.ops.isosurface import isosurface, without_cavities, without_floaters


def centres(n):
    return (np.arange(n) + 0.5) / n * 2 - 1


def radius(n):
    return np.linalg.norm(np.stack(np.meshgrid(*3 * [centres(n)], indexing="ij")), axis=0)


def soft_ball(n, r):
    """Occupancy falls from 1 to 0 over one voxel: the level 1/2 lies at r exactly."""
    return np.clip((r - radius(n)) / (2 / n) + 0.5, 0, 1)


def block(n, low, high):
    v = np.zeros((n, n, n), np.float32)
    v[low[0] : high[0], low[1] : high[1], low[2] : high[2]] = 1
    return v


def closed(volume, **options):
    vertices, faces = isosurface(volume, **options)
    for merge in (False, True):
        assert trimesh.Trimesh(vertices, faces, process=merge).is_watertight
    return trimesh.Trimesh(vertices, faces, process=False)


@pytest.mark.parametrize("smooth", [0, 6])
@pytest.mark.parametrize("n", [32, 33])
def test_a_ball_has_its_radius_volume_and_outward_normals(n, smooth):
    surface = closed(soft_ball(n, 0.7), smooth=smooth)
    distances = np.linalg.norm(surface.vertices, axis=1)
    assert np.abs(distances - 0.7).max() < 1 / n
    assert surface.volume == pytest.approx(4 / 3 * np.pi * 0.7**3, rel=0.03)
    assert (surface.vertices * surface.vertex_normals).sum(1).min() > 0


def test_a_binary_ball_is_exact_to_half_a_voxel():
    distances = np.linalg.norm(isosurface(radius(32) < 0.7)[0], axis=1)
    assert np.abs(distances - 0.7).max() < 2 / 32


def test_a_block_has_the_extents_of_its_voxels():
    surface = closed(block(20, (4, 0, 10), (16, 20, 15)))
    np.testing.assert_allclose(surface.bounds, [[-0.6, -1, 0], [0.6, 1, 0.5]], atol=2e-3)
    assert surface.volume == pytest.approx(1.2 * 2 * 0.5, rel=0.03)


def test_parts_are_kept_by_what_they_enclose_and_cavities_enclose_nothing():
    hollow = block(20, (4, 4, 4), (16, 16, 16)) - block(20, (6, 6, 6), (14, 14, 14))
    assert closed(hollow).body_count == 2
    kept = closed(hollow, min_fraction=0.02)
    assert kept.body_count == 1 and kept.volume == pytest.approx(1.2**3, rel=0.03)


def test_a_full_volume_is_closed_at_the_sides_of_its_box():
    np.testing.assert_allclose(closed(np.ones((8, 8, 8))).bounds, [[-1] * 3, [1] * 3], atol=2e-3)


def test_a_smoothed_surface_stays_inside_the_box():
    assert np.abs(closed(block(16, (0, 2, 5), (16, 8, 16)), smooth=6).vertices).max() == 1


def test_axes_of_different_lengths_each_span_the_box():
    vertices, _ = isosurface(np.ones((4, 8, 16)))
    np.testing.assert_allclose([vertices.min(0), vertices.max(0)], [[-1] * 3, [1] * 3], atol=2e-3)


@pytest.mark.parametrize("levels", [1, 2, 4, 1000], ids=lambda levels: f"{levels}-steps")
@pytest.mark.parametrize("smooth", [0, 6])
def test_noise_is_closed_whatever_its_ties(levels, smooth):
    noise = np.random.default_rng(levels).random((16, 16, 16))
    assert closed(np.round(noise * levels) / levels, smooth=smooth).volume > 0


def test_smoothing_lays_voxel_steps_flat():
    def roughness(smooth):
        surface = closed(radius(32) < 0.7, smooth=smooth)
        return np.degrees(surface.face_adjacency_angles).mean()

    assert roughness(6) < 0.6 * roughness(0)


@pytest.mark.parametrize(
    ("high", "thickness"),
    [((13, 20, 13), 1), ((14, 20, 14), 2), ((13, 20, 20), 1)],
    ids=["leg", "thicker-leg", "plate"],
)
def test_smoothing_keeps_what_is_thin_as_thick_as_it_was(high, thickness):
    v = block(24, (12, 4, 12), high)
    sharp, smooth = closed(v), closed(v, smooth=6)
    assert smooth.volume == pytest.approx(sharp.volume, rel=0.03)
    assert smooth.extents[0] == pytest.approx(thickness * 2 / 24, rel=0.25)


def test_tensors_and_types():
    vertices, faces = isosurface(torch.from_numpy(soft_ball(16, 0.5)))
    assert vertices.dtype == np.float32 and faces.dtype == np.int64
    assert faces.min() == 0 and faces.max() == len(vertices) - 1


def test_an_empty_volume_has_an_empty_surface():
    vertices, faces = isosurface(np.full((8, 8, 8), 0.4))
    assert vertices.shape == (0, 3) and faces.shape == (0, 3)


def test_floaters_go_and_diagonal_neighbours_stay():
    v = block(16, (2, 2, 2), (8, 8, 8)) + block(16, (8, 8, 8), (9, 9, 9)) + block(16, (12, 12, 12), (14, 14, 14))
    assert without_floaters(v).sum() == v.sum()
    assert without_floaters(v, min_fraction=0.02).sum() == v.sum()
    assert without_floaters(v, min_fraction=0.1).sum() == 6**3 + 1
    assert without_floaters(v, largest=True).sum() == 6**3 + 1
    assert isosurface(v, largest=True)[0].max() < 0.2


def test_voxels_that_touch_in_an_edge_are_one_body():
    assert closed(block(8, (2, 2, 2), (4, 4, 4)) + block(8, (4, 4, 2), (6, 6, 4))).body_count == 1


def test_hidden_hollows_are_filled_and_open_ones_are_not():
    cup = block(16, (2, 2, 2), (14, 14, 14)) - block(16, (5, 5, 5), (11, 11, 11))
    assert without_cavities(cup).sum() == 12**3
    cup[5:11, 11:, 5:11] = 0
    assert without_cavities(cup).sum() == cup.sum()


@pytest.mark.parametrize(
    ("volume", "level", "says"),
    [
        (np.zeros((4, 4)), 0.5, "three axes"),
        (np.full((4, 4, 4), np.nan), 0.5, "NaN"),
        (np.zeros((4, 4, 4)), 1.0, "level"),
    ],
)
def test_mistakes_are_named(volume, level, says):
    with pytest.raises(UserError, match=says):
        isosurface(volume, level)


@pytest.mark.parametrize("kind", [torch.bfloat16, torch.float64])
def test_tensors_of_any_precision_with_a_gradient_or_none(kind: torch.dtype) -> None:
    volume = torch.zeros(8, 8, 8, dtype=kind)
    volume[2:6, 2:6, 2:6] = 1
    expected = isosurface(volume.float().numpy())
    for given in (volume, volume.requires_grad_()):
        for found, wanted in zip(isosurface(given), expected, strict=True):
            assert np.array_equal(found, wanted)
        assert np.array_equal(without_cavities(given), without_floaters(given))


def test_parts_keep_the_type_of_the_volume() -> None:
    volume = torch.zeros(4, 4, 4, dtype=torch.float64)
    volume[1:3] = 1
    assert without_floaters(volume).dtype == without_cavities(volume).dtype == np.float64
