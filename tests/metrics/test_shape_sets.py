import itertools

import pytest
import torch

from unproject._random import generator_at
from unproject._types import UserError
from unproject.metrics.distances import chamfer, one_minus_iou
from unproject.metrics.shape_sets import coverage, minimum_matching_distance, one_nearest_neighbour_accuracy

# Three generated (rows) against two references (columns).
D = torch.tensor([[1.0, 5.0], [2.0, 9.0], [3.0, 4.0]])


def line(*positions):
    return torch.tensor(positions)[:, None]


def between(a, b):
    return (a - b.T).abs()


def test_mmd_by_hand():
    # Least of each column: 1 and 4; mean 2.5. (Axes swapped: least of each row 1, 2, 3; mean 2.)
    assert minimum_matching_distance(D) == 2.5
    assert minimum_matching_distance(D.T) == 2


def test_coverage_by_hand():
    # Every row is nearest to column 0: one of two references is covered. (Axes swapped: the columns' nearest
    # rows are 0 and 2, two of three.)
    assert coverage(D) == 0.5
    assert coverage(D.T) == pytest.approx(2 / 3)


def test_two_of_three_by_hand():
    # Pairs of rows of D: (0, 1) least 1, 5; (0, 2) least 1, 4; (1, 2) least 2, 4: mean 17 / 6. All rows are nearest
    # to column 0, so any pair covers one of two. Of D.T each row alone: mean least (1 + 2 + 3 + 5 + 9 + 4) / 6 = 4.
    assert minimum_matching_distance(D, 2) == pytest.approx(17 / 6)
    assert coverage(D, 2) == 0.5
    assert minimum_matching_distance(D.T, 1) == pytest.approx(4)
    assert coverage(D.T, 1) == pytest.approx(1 / 3)


@pytest.mark.parametrize("size", range(1, 7))
def test_a_size_is_the_mean_over_all_choices(size):
    d = torch.rand(6, 4, generator=generator_at(0))
    choices = [d[list(rows)] for rows in itertools.combinations(range(6), size)]
    expected = [
        sum(score(choice) for choice in choices) / len(choices) for score in (minimum_matching_distance, coverage)
    ]
    assert [minimum_matching_distance(d, size), coverage(d, size)] == pytest.approx(expected)


def test_large_sets_do_not_overflow():
    d = torch.arange(3000.0).repeat(2, 1).T  # the least of 1500 of 0..2999 is (3000 - 1500) / 1501 on average
    assert minimum_matching_distance(d, 1500) == pytest.approx(1500 / 1501, rel=1e-6)


@pytest.mark.parametrize("size", [0, 4])
def test_more_than_there_are(size):
    for score in (minimum_matching_distance, coverage):
        with pytest.raises(UserError, match="3 generated"):
            score(D, size)


def test_1nna_by_hand():
    # Generated at 0, 1, 10, references at 2, 11.5, 13 on a line. Nearest other: 0 -> 1 own; 1 -> 0 or 2, a tie: half;
    # 10 -> 11.5 other; 2 -> 1 other; 11.5 -> 10 or 13, a tie: half; 13 -> 11.5 own. (1 + .5 + 0 + 0 + .5 + 1) / 6.
    g, r = line(0.0, 1, 10), line(2.0, 11.5, 13)
    assert one_nearest_neighbour_accuracy(between(g, g), between(g, r), between(r, r)) == 0.5


def test_1nna_axes_by_hand():
    # Generated at 0, 1; references at 3, 10, 20. 0 -> 1 own, 1 -> 0 own; 3 -> 1 other; 10 -> 3 own; 20 -> 10 own: 4/5.
    # A swap of the minima of d_gr would not even have the right lengths, so swap the roles: still 4/5.
    g, r = line(0.0, 1), line(3.0, 10, 20)
    assert one_nearest_neighbour_accuracy(between(g, g), between(g, r), between(r, r)) == pytest.approx(0.8)
    assert one_nearest_neighbour_accuracy(between(r, r), between(r, g), between(g, g)) == pytest.approx(0.8)


def test_1nna_minima_of_the_right_axis():
    # d_gr = [[1, 9], [9, 9]]: least by row 1, 9; by column 1, 9. With d_gg 5 apart and d_rr 0.5 apart:
    # g0 1 < 5 other, g1 own; r0 0.5 own, r1 own: 3/4. With d_gr = [[1, 2], [9, 9]] rows give 1, 9 (other, own)
    # and columns 1, 2 (own, own): 3/4; the axes swapped would give 1, 2 for both generated: 2/4.
    gg, rr = torch.tensor([[0.0, 5], [5, 0]]), torch.tensor([[0.0, 0.5], [0.5, 0]])
    assert one_nearest_neighbour_accuracy(gg, torch.tensor([[1.0, 9], [9, 9]]), rr) == 0.75
    assert one_nearest_neighbour_accuracy(gg, torch.tensor([[1.0, 2], [9, 9]]), rr) == 0.75


def test_1nna_of_one_distribution_is_about_a_half_and_of_two_is_one():
    x = torch.randn(600, 2, generator=generator_at(0))
    g, r = x[:300], x[300:]
    # The standard deviation of the accuracy is at most sqrt(0.25 / 600) · sqrt(2) = 0.03.
    assert one_nearest_neighbour_accuracy(*(torch.cdist(*p) for p in ((g, g), (g, r), (r, r)))) == pytest.approx(
        0.5, abs=0.1
    )
    r = r + 100
    assert one_nearest_neighbour_accuracy(*(torch.cdist(*p) for p in ((g, g), (g, r), (r, r)))) == 1


def test_1nna_of_copies_is_zero_and_of_one_repeated_shape_a_half():
    x = line(0.0, 1, 5)
    assert one_nearest_neighbour_accuracy(*[between(x, x)] * 3) == 0
    assert one_nearest_neighbour_accuracy(*[torch.zeros(4, 4)] * 3) == 0.5


@pytest.mark.parametrize(
    ("distance", "items"),
    [
        (one_minus_iou, torch.rand(6, 5, 5, 5, generator=generator_at(1))),
        (chamfer, torch.rand(6, 20, 3, generator=generator_at(2))),
    ],
)
def test_equal_sets_match_and_cover_and_order_does_not_matter(distance, items):
    d = distance(items, items)
    assert minimum_matching_distance(d) == pytest.approx(0, abs=2e-6) and coverage(d) == 1
    rows, columns = torch.randperm(6, generator=generator_at(3)), torch.randperm(5, generator=generator_at(4))
    d = distance(items, items[:5] * 0.9)
    shuffled = distance(items[rows], (items[:5] * 0.9)[columns])
    assert minimum_matching_distance(shuffled) == pytest.approx(minimum_matching_distance(d), rel=1e-5)
    assert coverage(shuffled) == coverage(d)


@pytest.mark.parametrize(
    "call",
    [
        lambda: minimum_matching_distance(torch.zeros(0, 3)),
        lambda: coverage(torch.zeros(3, 0)),
        lambda: one_nearest_neighbour_accuracy(torch.zeros(0, 0), torch.zeros(0, 2), torch.zeros(2, 2)),
        lambda: one_nearest_neighbour_accuracy(torch.zeros(3, 3), torch.zeros(2, 2), torch.zeros(2, 2)),
    ],
)
def test_bad_matrices_are_the_users_to_mend(call):
    with pytest.raises(UserError):
        call()
