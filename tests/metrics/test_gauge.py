import math

import pytest
import torch

from unproject._random import generator_at
from unproject._types import UserError
from unproject.metrics.distances import one_minus_iou
from unproject.metrics.gauge import Gauge, apply, best_gauge, dihedral
from unproject.metrics.shape_sets import minimum_matching_distance
from unproject.ops.rotation import rotate_y
from unproject.projections import Silhouette


def blobs(n, side=16, seed=0):
    """Smooth lopsided solids inside the ball of radius 0.7: no symmetry, so their gauge is unique."""
    axis = (torch.arange(side) + 0.5) / side * 2 - 1
    grid = torch.stack(torch.meshgrid(axis, axis, axis, indexing="ij"), -1)
    rng = generator_at(seed, 0, "blobs")
    base = torch.tensor([[0.4, 0.2, 0.1], [-0.1, -0.3, 0.4], [0.0, 0.1, -0.15]])
    centres = base + 0.05 * torch.randn(n, 3, 3, generator=rng)
    radii = torch.tensor([0.3, 0.25, 0.2])
    distance = (grid[None, ..., None, :] - centres[:, None, None, None]).norm(dim=-1)
    return torch.sigmoid((radii - distance) * side).amax(-1)


def silhouette(volumes, k, bins=16):
    """The orthographic picture (B, H, W) at the centre of bin k, by the definition: 1 - Π (1 - p), row 0 on top."""
    turned = rotate_y(volumes, torch.full((len(volumes),), 2 * math.pi * k / bins))
    return (1 - (1 - turned).prod(-1)).transpose(1, 2).flip(1)


def test_dihedral_has_32_members_for_16_bins_and_begins_with_the_identity():
    gauges = dihedral(16)
    assert len(set(gauges)) == 32 and gauges[0] == Gauge(0, False, 16)
    assert sum(g.reflected for g in gauges) == 16


@pytest.mark.parametrize("gauge", [Gauge(t, r, 4) for t in range(4) for r in (False, True)])
def test_quarter_turn_gauges_are_exact_and_undone_by_their_inverse(gauge):
    x = torch.rand(2, 6, 6, 6, generator=generator_at(0))
    there = apply(x, gauge)
    assert sorted(there.flatten().tolist()) == sorted(x.flatten().tolist())
    assert torch.equal(apply(there, gauge.inverse), x)


def test_after_composes_as_the_volumes_do():
    x = torch.rand(1, 4, 4, 4, generator=generator_at(0))
    for first in dihedral(4):
        for then in dihedral(4):
            assert torch.equal(apply(apply(x, first), then), apply(x, then.after(first)))


def test_reflection_comes_before_the_turn():
    # One voxel at the +x end. Reflected it is at -x. Turned by 90°: the camera stands at +x and its right is -z,
    # so what was at -x is at the far end of w, index 0 of the last axis.
    x = torch.zeros(1, 4, 4, 4)
    x[0, 3, 0, 1] = 1
    found = apply(x, Gauge(1, True, 4)).nonzero()[0].tolist()
    # z index 1 (z < 0) is to the right of that camera (u = -z): u index 2.
    assert found == [0, 2, 0, 0]


def test_turns_agree_with_exact_quarter_turns():
    x = blobs(1)
    exact = apply(x, Gauge(4, False, 16))
    resampled = rotate_y(x, torch.tensor([math.pi / 2]))
    torch.testing.assert_close(exact, resampled, atol=1e-4, rtol=0)


@pytest.mark.parametrize("gauge", [Gauge(3), Gauge(4), Gauge(0, True), Gauge(4, True), Gauge(5, True), Gauge(13, True)])
@pytest.mark.parametrize("k", [0, 1, 6])
def test_a_gauged_shape_looks_as_the_shape_in_another_view(gauge, k):
    x = blobs(2)
    there = silhouette(apply(x, gauge), k)
    here = silhouette(x, int(gauge.view(torch.tensor(k))))
    # Two trilinear resamplings blur the outline: pictures differ there alone, and by far more in the views nearby.
    difference = (there - here).abs().mean()
    nearby = min((there - silhouette(x, int(gauge.view(torch.tensor(k))) + step)).abs().mean() for step in (-1, 1))
    assert difference < 0.02 and difference < nearby / 2


@pytest.mark.parametrize("gauge", [Gauge(0, True), Gauge(4), Gauge(12, True)])
def test_quarter_turn_gauges_relabel_views_exactly(gauge):
    x = blobs(1)
    for k in (0, 4, 8, 12):
        there, here = silhouette(apply(x, gauge), k), silhouette(x, int(gauge.view(torch.tensor(k))))
        torch.testing.assert_close(there, here, atol=1e-4, rtol=0)


def test_views_with_the_silhouette_operator():
    silhouette_module = pytest.importorskip("unproject.projections.silhouette")
    x, silhouette = blobs(1, side=24), silhouette_module.Silhouette()
    for gauge in (Gauge(0, True), Gauge(4), Gauge(8, True), Gauge(3), Gauge(6, True)):
        for k in (0, 3):
            seen = [
                silhouette(volume, azimuth=torch.tensor([2 * math.pi * int(view) / 16]))
                for volume, view in ((apply(x, gauge), k), (x, gauge.view(torch.tensor(k))))
            ]
            assert (seen[0] - seen[1]).abs().mean() < 0.02


@pytest.mark.parametrize("gauge", dihedral(8))
def test_the_gauge_of_a_turned_and_reflected_set_is_found(gauge):
    reference = blobs(4)
    generated = apply(reference, gauge)[[2, 0, 3, 1]]
    assert best_gauge(generated, reference, 8) == gauge.inverse


def test_the_gauge_is_found_among_32():
    reference = blobs(3)
    for gauge in (Gauge(3, False), Gauge(7, True)):
        found = best_gauge(apply(reference, gauge), reference)
        assert found == gauge.inverse
        before = minimum_matching_distance(one_minus_iou(apply(reference, gauge), reference))
        after = minimum_matching_distance(one_minus_iou(apply(apply(reference, gauge), found), reference))
        assert after < 0.15 < 0.6 < before


def test_a_set_of_many_parts_is_turned_whole(monkeypatch):
    x = blobs(5)
    whole = apply(x, Gauge(1))
    monkeypatch.setattr("unproject.metrics.gauge.VOLUMES_AT_ONCE", 2)
    torch.testing.assert_close(apply(x, Gauge(1)), whole)


def test_bad_gauges_and_sets_are_the_users_to_mend():
    with pytest.raises(UserError, match="even"):
        Gauge(0, False, 15)
    with pytest.raises(UserError, match="empty"):
        best_gauge(torch.zeros(0, 4, 4, 4), torch.zeros(1, 4, 4, 4))
    with pytest.raises(UserError, match="resample"):
        best_gauge(torch.zeros(1, 4, 4, 4), torch.zeros(1, 8, 8, 8))


@pytest.mark.parametrize("gauge", [Gauge(3, False, 16), Gauge(5, True, 16)])
def test_an_azimuth_moves_as_bins_do(gauge: Gauge) -> None:
    """And T F x has from there what x has from the azimuth that is returned."""
    k = torch.arange(16)
    moved = gauge.azimuth_of(k * math.pi / 8) * 8 / math.pi
    torch.testing.assert_close(moved.remainder(16).round().remainder(16), gauge.view(k).float())
    quarter = Gauge(4, gauge.reflected, 16)
    x, azimuth, look = blobs(2), torch.tensor([0.3, 2.0]), Silhouette(size=16)
    seen = look(apply(x, quarter), azimuth=azimuth)
    torch.testing.assert_close(look(x, azimuth=quarter.azimuth_of(azimuth)), seen, atol=1e-3, rtol=0)
