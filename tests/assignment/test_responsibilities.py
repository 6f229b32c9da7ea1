"""Responsibilities: clusters are found, draws follow the probabilities, windows and balance do what they say."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.assignment import Estimator
from unproject.assignment.responsibilities import balanced, k_means, likeliest_window, renumbered, uniform_views

# Clusters


def blobs(spread: float) -> tuple[Tensor, Tensor]:
    """20, 30 and 5 points around the unit vectors, shuffled, and which blob each is of."""
    counts = (20, 30, 5)
    label = torch.arange(len(counts)).repeat_interleave(torch.tensor(counts))
    label = label[torch.randperm(len(label), generator=generator_at(0, 0, "shuffle"))]
    noise = torch.randn(len(label), len(counts), generator=generator_at(0, 0, "noise"))
    return torch.eye(len(counts))[label] + spread * noise, label


@pytest.mark.parametrize("seed", range(5))
def test_separated_blobs_are_the_clusters(seed: int) -> None:
    rows, label = blobs(spread=0.01)
    cluster = k_means(rows, 3, seed)
    pairs = set(zip(label.tolist(), cluster.tolist()))
    assert len(pairs) == 3 and len({c for _, c in pairs}) == 3


def test_clusters_found_again_are_those_of_before() -> None:
    rows, _ = blobs(spread=0.1)
    found = [k_means(rows, 3, seed) for seed in range(6)]
    assert not all(torch.equal(labels, found[0]) for labels in found)  # numbered anew each time
    assert all(torch.equal(renumbered(labels, found[0], 3), found[0]) for labels in found)
    others = torch.full_like(found[0], 3)  # of another head
    assert sorted(renumbered(found[0], others, 3).unique().tolist()) == [0, 1, 2]


def test_clusters_are_a_function_of_the_seed_and_leave_the_rows() -> None:
    rows, _ = blobs(spread=0.5)
    before = rows.clone()
    assert torch.equal(k_means(rows, 3, 1), k_means(rows, 3, 1))
    assert torch.equal(rows, before)


def test_every_row_is_in_the_cluster_of_the_nearest_mean() -> None:
    rows, _ = blobs(spread=0.7)
    cluster = k_means(rows, 3, 0)
    means = torch.stack([rows[cluster == c].mean(0) for c in range(3)])
    assert torch.equal(torch.cdist(rows, means).argmin(1), cluster)


def test_one_cluster_and_more_clusters_than_there_are_rows() -> None:
    rows, label = blobs(spread=0)
    assert (k_means(rows, 1, 0) == 0).all()
    cluster = k_means(rows, 5, 0)
    assert len(set(zip(label.tolist(), cluster.tolist()))) == 3


# Views


def test_the_most_probable_view_or_a_draw() -> None:
    p = torch.tensor([[0.1, 0.6, 0.3, 0.0]]).repeat(6000, 1)
    views, heads = Estimator("argmax").assign(p, 0)
    assert (views == 1).all() and torch.equal(views, heads)
    views, heads = Estimator("posterior").assign(p, 0)
    drawn = torch.bincount(views, minlength=4) / 6000
    assert drawn[3] == 0 and torch.equal(views, heads)
    torch.testing.assert_close(drawn, p[0], rtol=0, atol=0.02)


def test_clusters_are_heads() -> None:
    rows, label = blobs(spread=0.01)
    views, heads = Estimator(clusters=3).assign(rows.softmax(1), 0)
    assert torch.equal(views, rows.argmax(1)) and len(set(zip(label.tolist(), heads.tolist()))) == 3


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"draw": "softmax"}, "choose argmax or posterior"),
        ({"clusters": 0}, "clusters=0"),
        ({"window": 0}, "window=0"),
        ({"balance": 1.5}, "balance=1.5"),
        ({"anywhere": 0.0}, "anywhere=0.0"),
        ({"anywhere": 1.0}, "anywhere=1.0"),
    ],
    ids=str,
)
def test_wrong_settings_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        Estimator(**wrong)


def test_uniform_views_are_uniform() -> None:
    views = uniform_views(16_000, 16, seed=0)
    counts = torch.bincount(views, minlength=16)
    # χ² with 15 degrees of freedom exceeds 37.7 once in a thousand seeds.
    assert len(counts) == 16 and ((counts - 1000) ** 2 / 1000).sum() < 37.7
    assert torch.equal(views, uniform_views(16_000, 16, seed=0))
    assert not torch.equal(views, uniform_views(16_000, 16, seed=1))


def test_balanced_means_reach_their_target_and_rows_stay_probabilities() -> None:
    p = torch.rand(200, 4, generator=generator_at(0)) * torch.tensor([8.0, 1.0, 1.0, 0.5])
    p = p / p.sum(1, keepdim=True)
    assert torch.allclose(balanced(p, 1.0).mean(0), torch.full((4,), 0.25), atol=1e-3)
    half = p.mean(0).sqrt() / p.mean(0).sqrt().sum()
    assert torch.allclose(balanced(p, 0.5).mean(0), half, atol=1e-3)
    assert torch.allclose(balanced(p, 0.0), p, atol=1e-5)
    assert torch.allclose(balanced(p, 0.7).sum(1), torch.ones(200))


# Windows


def around(first: int, length: int, count: int = 8, seed: int = 0) -> Tensor:
    """Probabilities of images whose views are the `length` after `first`: 0.6 for the right one, noise elsewhere."""
    rng = generator_at(seed, 0, "around")
    true = (first + torch.randint(length, (300,), generator=rng)) % count
    odds = torch.rand(300, count, generator=rng)
    odds = 0.4 * odds / odds.sum(1, keepdim=True)
    return odds.scatter_add(1, true[:, None], torch.full((300, 1), 0.6))


@pytest.mark.parametrize("first", [0, 3, 6])
def test_the_window_of_views_is_found_over_the_end_too(first: int) -> None:
    assert likeliest_window(around(first, 4), 4).tolist() == [(first + k) % 8 for k in range(4)]
    assert sorted(likeliest_window(around(first, 4), 20).tolist()) == list(range(8))


def test_responsibilities_keep_to_the_window() -> None:
    settings = Estimator(window=4, balance=1.0)
    found = settings.responsibilities(around(6, 4))
    assert found[:, 2:6].eq(0).all() and torch.allclose(found.sum(1), torch.ones(300))
    torch.testing.assert_close(found.mean(0)[[6, 7, 0, 1]], torch.full((4,), 0.25), atol=1e-3, rtol=0)
    whole = Estimator().responsibilities(around(6, 4))
    torch.testing.assert_close(whole, around(6, 4))


def test_an_image_that_fits_nowhere_in_the_window_still_gets_a_view() -> None:
    odds = torch.tensor([[1.0, 0, 0, 0]] * 9 + [[0, 0, 1.0, 0]])
    found = Estimator(window=2).responsibilities(odds)
    assert torch.isfinite(found).all() and torch.allclose(found.sum(1), torch.ones(10))
