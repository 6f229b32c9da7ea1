import math

import pytest
import torch

from unproject._random import generator_at
from unproject._types import UserError
from unproject.metrics.distances import chamfer, exposed_faces, one_minus_iou, surface_points


def box(low, high, side=8):
    volume = torch.zeros(side, side, side)
    volume[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = 1
    return volume


def test_iou_of_overlapping_boxes():
    # Two 4 x 4 x 4 boxes (64 cells each) two cells apart in x share 2 x 4 x 4 = 32; union 96; 1 - 1/3 = 2/3.
    # The second and a 2 x 4 x 4 box inside it share 32 of 64: 1/2.
    a = box((0, 0, 0), (4, 4, 4))[None]
    b = torch.stack([box((2, 0, 0), (6, 4, 4)), box((0, 0, 0), (2, 4, 4)), box((5, 5, 5), (8, 8, 8))])
    torch.testing.assert_close(one_minus_iou(a, b), torch.tensor([[2 / 3, 1 / 2, 1.0]]))


def test_iou_of_empty_members():
    empty, full = torch.zeros(1, 4, 4), torch.ones(1, 4, 4)
    assert one_minus_iou(empty, torch.cat([empty, full])).tolist() == [[0, 1]]


def test_iou_threshold_is_strictly_above_a_half():
    # Above 0.5: cell 1 of a; cells 1 and 2 of b. 1 - 1/2.
    a, b = torch.tensor([[0.5, 0.51, 0.0]]), torch.tensor([[0.5, 0.9, 0.6]])
    assert one_minus_iou(a, b).item() == 0.5


def test_iou_takes_silhouettes_and_more_cells_than_a_block():
    a = torch.rand(3, 1, 200, 100, generator=generator_at(0))
    b = torch.rand(2, 1, 200, 100, generator=generator_at(1))
    m, n = (a > 0.5)[:, None].flatten(2), (b > 0.5)[None].flatten(2)
    expected = 1 - (m & n).sum(-1) / (m | n).sum(-1)
    torch.testing.assert_close(one_minus_iou(a, b), expected)
    torch.testing.assert_close(one_minus_iou(a.double(), b), expected)


def test_chamfer_of_a_translated_set():
    # (0,0,0), (10,0,0) against the same moved by (0,1,2): nearest squared distance 1 + 4 = 5 both ways: 5 + 5.
    a = torch.tensor([[[0.0, 0, 0], [10, 0, 0]]])
    assert chamfer(a, a + torch.tensor([0.0, 1, 2])).item() == pytest.approx(10, abs=1e-4)


def test_chamfer_averages_each_side_over_its_own_points():
    # a = {0, 1}, b = {1, 3, 5} on a line. a to b: 1, 0 -> mean 1/2. b to a: 0, 4, 16 -> mean 20/3. Sum 43/6.
    # (Squared: unsquared distances would give 1/2 + 2. One side only: 1/2 or 20/3.)
    a, b = torch.zeros(1, 2, 3), torch.zeros(1, 3, 3)
    a[0, :, 0], b[0, :, 0] = torch.tensor([0.0, 1]), torch.tensor([1.0, 3, 5])
    assert chamfer(a, b).item() == pytest.approx(43 / 6, rel=1e-5)
    assert chamfer(b, a).item() == pytest.approx(43 / 6, rel=1e-5)


def test_chamfer_equals_the_plain_formula_and_leaves_the_threads_as_they_were():
    a, b = torch.rand(3, 40, 3, generator=generator_at(0)), torch.rand(5, 30, 3, generator=generator_at(1))
    square = torch.cdist(a[:, None].double(), b[None].double()).square()
    expected = (square.amin(-1).mean(-1) + square.amin(-2).mean(-1)).float()
    threads = torch.get_num_threads()
    torch.testing.assert_close(chamfer(a, b), expected, atol=2e-6, rtol=1e-5)
    assert torch.get_num_threads() == threads


def test_chamfer_of_a_set_and_itself_is_nothing():
    a = torch.rand(4, 100, 3, generator=generator_at(0)) * 2 - 1
    own = chamfer(a, a).diagonal()
    assert own.min() >= 0 and own.max() < 1e-5


def test_exposed_faces_of_two_neighbouring_voxels():
    # Two cubes sharing a face expose 12 - 2 = 10 faces; a full grid exposes its 6 sides.
    assert exposed_faces(box((1, 1, 1), (3, 2, 2), 4) > 0).sum() == 10
    assert exposed_faces(torch.ones(3, 3, 3, dtype=torch.bool)).sum() == 6 * 9


def test_surface_points_lie_on_the_box_and_are_uniform_by_area():
    # x from 2 to 6 of 8 cells is -0.5 to 0.5; y from 3 to 5 is -0.25 to 0.25; z from 4 to 8 is 0 to 1.
    # Areas: x sides 2 · (0.5 · 1) = 1, y sides 2 · (1 · 1) = 2, z sides 2 · (1 · 0.5) = 1: shares 1/4, 1/2, 1/4.
    p = surface_points(box((2, 3, 4), (6, 5, 8))[None], 4000, generator_at(0))[0]
    low, high = torch.tensor([-0.5, -0.25, 0]), torch.tensor([0.5, 0.25, 1])
    assert (p >= low).all() and (p <= high).all()
    on_side = ((p == low) | (p == high)).double()
    assert (on_side.sum(1) >= 1).all()
    four_sigma = 4 * math.sqrt(0.25 / 4000)
    torch.testing.assert_close(on_side.mean(0), torch.tensor([0.25, 0.5, 0.25]).double(), atol=four_sigma, rtol=0)
    torch.testing.assert_close(p.mean(0), torch.tensor([0, 0, 0.5]), atol=0.03, rtol=0)


def test_surface_points_repeat_with_the_seed_and_differ_between_volumes():
    volumes = torch.stack([box((0, 0, 0), (4, 4, 4))] * 2)
    first, again = (surface_points(volumes, 16, generator_at(3)) for _ in range(2))
    assert torch.equal(first, again) and not torch.equal(first[0], first[1])


def test_an_empty_volume_has_its_points_at_the_origin():
    assert surface_points(torch.zeros(1, 4, 4, 4), 5, generator_at(0)).tolist() == [[[0, 0, 0]] * 5]


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: one_minus_iou(torch.zeros(0, 4, 4), torch.zeros(2, 4, 4)), "empty"),
        (lambda: one_minus_iou(torch.zeros(2, 4, 4), torch.zeros(0, 4, 4)), "empty"),
        (lambda: one_minus_iou(torch.zeros(2, 4, 4), torch.zeros(2, 8, 8)), "resample"),
        (lambda: one_minus_iou(torch.full((1, 4), math.nan), torch.zeros(1, 4)), "NaN"),
        (lambda: chamfer(torch.zeros(0, 4, 3), torch.zeros(2, 4, 3)), "empty"),
        (lambda: chamfer(torch.zeros(2, 4, 3), torch.zeros(2, 4, 2)), "dimensions"),
        (lambda: chamfer(torch.zeros(4, 3), torch.zeros(4, 3)), "dimensions"),
        (lambda: surface_points(torch.zeros(0, 4, 4, 4), 5, generator_at(0)), "empty"),
        (lambda: surface_points(torch.zeros(1, 4, 4, 5), 5, generator_at(0)), "N, N, N"),
    ],
)
def test_bad_sets_are_the_users_to_mend(call, word):
    with pytest.raises(UserError, match=word):
        call()
