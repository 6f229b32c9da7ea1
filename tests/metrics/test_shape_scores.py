import dataclasses
import json

import pytest
import torch

from unproject._random import generator_at
from unproject._types import UserError
from unproject.metrics.gauge import Gauge, apply
from unproject.metrics.picture_sets import root_mean_square
from unproject.metrics.shape_scores import drawn, set_scores, shape_scores
from unproject.metrics.shape_sets import coverage, minimum_matching_distance

SCORES = ("mmd_{}", "cov_{}", "mmd_{}_equal", "cov_{}_equal", "1nna_{}")
NAMES = {score.format(distance) for score in SCORES for distance in ("iou", "chamfer")}


def bar(*positions, side=8):
    """One 4 x 2 x 2 bar of voxels a position along y, off the axis in x and z."""
    volumes = torch.zeros(len(positions), side, side, side)
    for volume, y in zip(volumes, positions, strict=True):
        volume[3:7, y : y + 2, 1:3] = 1
    return volumes


def test_scores_by_hand_as_the_shapes_stand():
    # Generated bars at y = 0, 1 and 0, references at 0 and 5. IoU: bars one apart share 8 of 24, so D is
    # [[0, 1], [2/3, 1], [0, 1]]: MMD (0 + 1) / 2; COV: rows' nearest are 0, 0, 0: 1/2.
    # 1-NNA on the first two of each: g0 (own 2/3, other 0) no, g1 (2/3, 2/3) half, r0 (1, 0) no, r1 (1, 1) half: 1/4.
    scores = shape_scores(bar(0, 1, 0), bar(0, 5), bins=None, points=64)
    assert scores["mmd_iou"].value == 0.5
    assert scores["cov_iou"].value == 0.5
    assert scores["1nna_iou"].value == 0.25
    # Two of three: (0, 1) and (1, 2) leave the least 0 and 1 of the columns, (0, 2) too.
    assert (scores["mmd_iou_equal"].value, scores["cov_iou_equal"].value) == (0.5, 0.5)
    assert "all choices of 2 of 3 generated vs 2 reference" in scores["mmd_iou_equal"].protocol
    assert (scores["mmd_iou"].n, scores["1nna_iou"].n) == (3, 2)
    assert set(scores) == NAMES | {"empty"}


def test_sets_of_equal_size_are_so_where_references_are_more():
    """So few generated items can cover a tenth of all references at most."""
    generated, reference = (torch.rand(n, 4, generator=generator_at(n)) for n in (20, 200))
    scores = set_scores("rms", root_mean_square, generated, reference, "rms), {} generated vs {} reference")
    assert scores["cov_rms"].value <= 0.1 < 0.4 < scores["cov_rms_equal"].value
    few = root_mean_square(generated, reference[drawn(200, 20, 0)])
    assert scores["cov_rms_equal"].value == pytest.approx(coverage(few))
    assert scores["mmd_rms_equal"].value == pytest.approx(minimum_matching_distance(few))
    assert scores["cov_rms_equal"].protocol == "cov(rms), all choices of 20 of 20 generated vs 20 reference"


def test_one_shape_has_no_neighbour_of_its_own_set():
    for sets in ((bar(0), bar(0, 5)), (bar(0, 5), bar(0)), (bar(0), bar(0))):
        scores = shape_scores(*sets, bins=None, points=16)
        assert scores.keys() == NAMES - {"1nna_iou", "1nna_chamfer"} | {"empty"}


def test_mmd_chamfer_by_hand():
    # A bar 2 · 2/8 = 0.5 away in y, both 0.5 high: the top face of one is the bottom face of the other. With n points
    # the sampled nearest distances only exceed the true ones, towards which they go with n. True value, by symmetry
    # 2 · mean over the surface of d²: the face that touches 0, the far face 0.5², the other faces distance y in
    # [0, 0.5] from the plane of contact, mean y² = 0.25/3. Areas, in voxel faces: top and bottom 8 each,
    # sides 2 · (4 · 2 + 2 · 2) = 24. 2 · (8 · 0.25 + 24 · 0.25 / 3) / 40 = 0.2.
    scores = shape_scores(bar(2), bar(4), bins=None, points=2000)
    assert scores["mmd_chamfer"].value == pytest.approx(0.2, rel=0.05)
    assert scores["cov_chamfer"].value == 1
    assert "2000 points" in scores["mmd_chamfer"].protocol


def test_equal_sets_after_any_exact_gauge():
    reference = bar(0, 2, 5)
    for gauge in (Gauge(0, False, 4), Gauge(3, False, 4), Gauge(1, True, 4)):
        scores = shape_scores(apply(reference, gauge), reference, bins=4, points=256)
        assert scores["mmd_iou"].value == 0 and scores["cov_iou"].value == 1 and scores["cov_chamfer"].value == 1
        assert scores["mmd_chamfer"].value < 0.02
        found = Gauge(int(scores["gauge_turn"].value), bool(scores["gauge_reflected"].value), 4)
        assert torch.equal(apply(apply(reference, gauge), found), reference)


def test_the_selection_alone_chooses_the_gauge():
    # The selection is the turned set, so the identity is chosen although a turn would fit the references.
    reference = bar(0, 5)
    turned = apply(reference, Gauge(1, False, 4))
    assert shape_scores(turned, reference, selection=turned, bins=4, points=16)["mmd_iou"].value > 0.5
    assert shape_scores(turned, reference, bins=4, points=16)["mmd_iou"].value == 0


def test_protocols_say_everything():
    reference = bar(0, 5)
    scores = shape_scores(bar(0, 1, 2), reference, selection=bar(3), bins=4, points=16, seed=7)
    assert scores["mmd_iou"].protocol == (
        "mmd(1-iou), 8^3 at 0.5, 3 generated vs 2 reference, "
        "best of 8 dihedral gauges by mmd(1-iou) of 3 generated to 1 of other shapes"
    )
    assert "2 generated vs 2 reference" in scores["1nna_chamfer"].protocol
    assert "the references" in shape_scores(reference, reference, bins=4, points=16)["cov_iou"].protocol
    assert "as it stands" in shape_scores(reference, reference, bins=None, points=16)["cov_iou"].protocol
    assert all(score.seed == 7 for score in scores.values())
    assert set(json.loads(json.dumps(dataclasses.asdict(scores["mmd_iou"])))) == {"value", "protocol", "n", "seed"}


def test_scores_repeat_with_the_seed_and_change_with_it():
    values = [shape_scores(bar(0, 1), bar(3), bins=None, points=32, seed=s)["mmd_chamfer"].value for s in (0, 0, 1)]
    assert values[0] == values[1] != values[2]


def test_empty_volumes_are_counted_and_do_not_cover():
    generated = torch.cat([torch.zeros(1, 8, 8, 8), bar(0)])
    scores = shape_scores(generated, bar(0, 5), bins=None, points=64)
    assert scores["empty"].value == 0.5
    assert scores["mmd_iou"].value == 0.5


@pytest.mark.parametrize(
    ("generated", "reference"),
    [
        (torch.zeros(0, 8, 8, 8), bar(0)),
        (bar(0), torch.zeros(0, 8, 8, 8)),
        (bar(0), bar(0, side=16)),
        (bar(0)[:, None], bar(0)),
        (bar(0) * float("nan"), bar(0)),
        (torch.rand(2, 4, 5, 6, generator=generator_at(0)), torch.rand(2, 4, 5, 6, generator=generator_at(1))),
    ],
)
def test_bad_sets_are_the_users_to_mend(generated, reference):
    with pytest.raises(UserError):
        shape_scores(generated, reference, bins=None)
