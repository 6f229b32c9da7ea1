"""Distances of feature sets: closed forms, sets laid out by hand, and what each must not care about."""

import math

import pytest
import torch

from unproject._random import generator_at
from unproject._types import UserError
from unproject.metrics import feature_sets
from unproject.metrics.feature_sets import (
    cubic_kernel,
    density_coverage,
    frechet_distance,
    kernel_distance,
    precision_recall,
)


def normal(n, d, seed, mean=0.0, deviation=1.0):
    return torch.randn(n, d, generator=generator_at(seed, 0, "normal")).double() * deviation + mean


def test_kernel_distance_by_hand():
    # One feature, x = {0, 1}, y = {1, 2}: k(a, b) = (ab + 1)³. x pairs: k(0, 1) = 1, mean 1. y pairs: k(1, 2) = 27.
    # Across: k(0,1) = 1, k(0,2) = 1, k(1,1) = 8, k(1,2) = 27, mean 37/4. 1 + 27 - 37/2 = 9.5.
    # (With the diagonals, biased: (1+1+1+8)/4 + (8+27+27+125)/4 - 18.5 = 31.)
    x, y = torch.tensor([[0.0], [1.0]]), torch.tensor([[1.0], [2.0]])
    assert kernel_distance(x, y) == pytest.approx(9.5)
    assert kernel_distance(y, x) == pytest.approx(9.5)


def test_kernels_of_large_sets_are_added_up_part_by_part(monkeypatch):
    x, y = normal(70, 3, 0), normal(50, 3, 1, 0.5)
    whole, largest = kernel_distance(x, y), []

    def kernel(some, others):
        largest.append(len(some))
        return cubic_kernel(some, others)

    monkeypatch.setattr(feature_sets, "ROWS", 16)
    monkeypatch.setattr(feature_sets, "cubic_kernel", kernel)
    assert kernel_distance(x, y) == pytest.approx(whole, rel=1e-12)
    assert max(largest) == 16


@pytest.mark.parametrize("score", [frechet_distance, kernel_distance, precision_recall, density_coverage])
def test_features_that_are_not_finite_are_refused(score):
    x = normal(8, 3, 0)
    for broken in (float("nan"), float("inf")):
        other = x.clone()
        other[2, 1] = broken
        for pair in ((x, other), (other, x)):
            with pytest.raises(UserError, match="NaN or infinite; leave out"):
                score(*pair)


def test_kernel_divides_by_the_number_of_features():
    # (1·3 + 2·4) / 2 + 1 = 6.5.
    assert cubic_kernel(torch.tensor([[1.0, 2]]), torch.tensor([[3.0, 4]])).item() == pytest.approx(6.5**3)


def test_frechet_of_axis_aligned_normals_is_the_closed_form():
    # Sets whose sample moments are exact: standardise, then scale. FD = |shift|² + Σ (s_x - s_y)².
    x, y = (standardised(normal(200, 3, seed)) for seed in (0, 1))
    scales = torch.tensor([1.0, 2, 0.5]), torch.tensor([3.0, 2, 0.1])
    shift = torch.tensor([1.0, -2, 0])
    expected = 5 + (scales[0] - scales[1]).square().sum().item()
    assert frechet_distance(x * scales[0], y * scales[1] + shift) == pytest.approx(expected, rel=1e-6)


def test_frechet_of_turned_normals():
    """Covariances that do not commute, against the root by another way: the eigenvalues of C_x C_y."""
    x, y = normal(100, 4, 0) @ normal(4, 4, 1), normal(80, 4, 2) @ normal(4, 4, 3) + 1
    c_x, c_y = x.T.cov(), y.T.cov()
    cross = torch.linalg.eigvals(c_x @ c_y).real.clamp_min(0).sqrt().sum()
    expected = (x.mean(0) - y.mean(0)).square().sum() + c_x.trace() + c_y.trace() - 2 * cross
    assert frechet_distance(x, y) == pytest.approx(expected.item(), rel=1e-6)
    assert frechet_distance(y, x) == pytest.approx(expected.item(), rel=1e-6)


def test_frechet_of_a_set_with_itself_is_nought_even_if_it_is_flat():
    x = normal(50, 3, 0)
    x[:, 2] = x[:, 0]
    assert abs(frechet_distance(x, x)) < 1e-5
    line = normal(50, 1, 0)
    assert frechet_distance(line, line * 2) == pytest.approx((line.mean() ** 2 + line.std() ** 2).item(), rel=1e-6)


def standardised(x):
    x = x - x.mean(0)
    values, vectors = torch.linalg.eigh(x.T.cov())
    return x @ vectors / values.sqrt()


def test_precision_and_recall_by_hand():
    # References 0, 1, 2, 3, k = 1: radii 1. Generated 0.5, 0.6, 2.5, 9: three inside, radii 0.1, 0.1, 1.9, 6.5.
    # A reference is recalled by 2.5 (within 1.9: 1, 2, 3) or by 9 (within 6.5: 3); 0 is further than 0.1 from 0.5.
    reference, generated = torch.tensor([[0.0], [1], [2], [3]]), torch.tensor([[0.5], [0.6], [2.5], [9]])
    assert precision_recall(generated, reference, k=1) == (0.75, 0.75)


def test_density_and_coverage_by_hand():
    # As above. Balls around references hold: 0: 0.5, 0.6; 1: 0.5, 0.6; 2: 2.5; 3: 2.5. Six of k · 4 = 4.
    reference, generated = torch.tensor([[0.0], [1], [2], [3]]), torch.tensor([[0.5], [0.6], [2.5], [9]])
    assert density_coverage(generated, reference, k=1) == (1.5, 1.0)
    assert density_coverage(generated[:2], reference, k=1) == (2.0, 0.5)


def test_a_dropped_mode_costs_recall_and_coverage_and_an_invented_one_precision_and_density():
    reference = torch.cat([normal(100, 2, 0), normal(100, 2, 1, mean=20)])
    dropped = normal(200, 2, 2)
    invented = torch.cat([normal(70, 2, 3), normal(70, 2, 4, mean=20), normal(60, 2, 5, mean=-20)])
    precision, recall = precision_recall(dropped, reference)
    assert precision > 0.9 and recall < 0.55 and density_coverage(dropped, reference)[1] < 0.55
    precision, recall = precision_recall(invented, reference)
    assert precision < 0.75 and recall > 0.9 and density_coverage(invented, reference)[0] < 0.8


def test_two_samples_of_one_distribution():
    x, y = normal(400, 3, 0), normal(400, 3, 1)
    density, coverage = density_coverage(x, y)
    assert min(precision_recall(x, y)) > 0.9 and coverage > 0.9 and math.isclose(density, 1, abs_tol=0.1)


@pytest.mark.parametrize("distance", [frechet_distance, kernel_distance, precision_recall, density_coverage])
def test_sets_that_cannot_be_compared(distance):
    for x, y in ((normal(1, 2, 0), normal(9, 2, 0)), (normal(9, 2, 0), normal(9, 3, 0))):
        with pytest.raises(UserError, match="items of one size"):
            distance(x, y)
