"""Assignment: clusters that are there are found, classes that can be told apart are learned, draws follow the odds."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest
import torch
from torch import Tensor, nn
from torch.optim.optimizer import register_optimizer_step_pre_hook

from unproject._random import generator_at, seeded
from unproject._types import UserError
from unproject.adversarial.assignment import (
    Predicted,
    balanced,
    choose_ways,
    estimated,
    k_means,
    likeliest_run,
    predict,
    train_predictor,
    uniform_ways,
)
from unproject.networks import ViewPredictor

SMALL = partial(ViewPredictor, channels=4)


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
    cluster = k_means(rows, 3, generator_at(seed))
    pairs = set(zip(label.tolist(), cluster.tolist()))
    assert len(pairs) == 3 and len({c for _, c in pairs}) == 3


def test_clusters_are_a_function_of_the_generator_and_leave_the_rows() -> None:
    rows, _ = blobs(spread=0.5)
    before = rows.clone()
    assert torch.equal(k_means(rows, 3, generator_at(1)), k_means(rows, 3, generator_at(1)))
    assert torch.equal(rows, before)


def test_every_row_is_in_the_cluster_of_the_nearest_mean() -> None:
    rows, _ = blobs(spread=0.7)
    cluster = k_means(rows, 3, generator_at(0))
    means = torch.stack([rows[cluster == c].mean(0) for c in range(3)])
    assert torch.equal(torch.cdist(rows, means).argmin(1), cluster)


def test_one_cluster_and_more_clusters_than_there_are_rows() -> None:
    rows, label = blobs(spread=0)
    assert (k_means(rows, 1, generator_at(0)) == 0).all()
    cluster = k_means(rows, 5, generator_at(0))
    assert len(set(zip(label.tolist(), cluster.tolist()))) == 3


# Ways of looking


def test_the_most_probable_way_or_a_draw() -> None:
    odds = torch.tensor([[0.1, 0.6, 0.3, 0.0]]).repeat(6000, 1)
    assert (choose_ways(odds, "argmax", generator_at(0)) == 1).all()
    drawn = torch.bincount(choose_ways(odds, "posterior", generator_at(0)), minlength=4) / 6000
    assert drawn[3] == 0
    torch.testing.assert_close(drawn, odds[0], rtol=0, atol=0.02)


def test_uniform_ways_are_uniform() -> None:
    ways = uniform_ways(16_000, 16, seed=0)
    counts = torch.bincount(ways, minlength=16)
    # χ² with 15 degrees of freedom exceeds 37.7 once in a thousand seeds.
    assert len(counts) == 16 and ((counts - 1000) ** 2 / 1000).sum() < 37.7
    assert torch.equal(ways, uniform_ways(16_000, 16, seed=0))
    assert not torch.equal(ways, uniform_ways(16_000, 16, seed=1))


# The predictor


def quadrants(n: int = 256) -> tuple[Tensor, Tensor]:
    """Noisy images with one bright quadrant, and which."""
    way = torch.randint(4, (n,), generator=generator_at(0, 0, "ways"))
    images = 0.3 * torch.rand(n, 1, 16, 16, generator=generator_at(0, 0, "noise"))
    for i, w in enumerate(way.tolist()):
        images[i, 0, 8 * (w // 2) :, 8 * (w % 2) :][:8, :8] += 0.6
    return images, way


def trained(settings: Predicted, images: Tensor, ways: Tensor) -> tuple[nn.Module, float]:
    with seeded(0, "predictor"):
        predictor = settings.predictor((1, 16, 16), 4)
    return predictor, train_predictor(predictor, images, ways, settings, seed=0)


def test_separable_classes_are_learned_at_once() -> None:
    images, ways = quadrants()
    predictor, loss = trained(Predicted(SMALL, steps=40, batch=32), images, ways)
    assert not predictor.training and loss < 0.4
    assert (predict(predictor, images).argmax(1) == ways).float().mean() > 0.97


def test_shuffled_labels_are_not_learned() -> None:
    images, ways = quadrants()
    _, loss = trained(Predicted(SMALL, steps=40, batch=32), images, ways.flip(0))
    assert loss > 0.8


def test_training_is_a_function_of_the_seed() -> None:
    images, ways = quadrants()
    settings = Predicted(SMALL, steps=25, batch=16)
    first, loss = trained(settings, images, ways)
    torch.manual_seed(99)
    second, again = trained(settings, images, ways)
    assert loss == again
    assert all(torch.equal(a, b) for a, b in zip(first.state_dict().values(), second.state_dict().values()))


def test_the_learning_rate_falls_to_zero() -> None:
    rates: list[float] = []
    watch = register_optimizer_step_pre_hook(lambda adam, *_: rates.append(adam.param_groups[0]["lr"]))
    try:
        trained(Predicted(SMALL, steps=4, batch=8, learning_rate=1.0), *quadrants(8))
    finally:
        watch.remove()
    assert rates == [1.0, 0.75, 0.5, 0.25]


class Spy(ViewPredictor):
    def __init__(self, shape: tuple[int, ...], bins: int) -> None:
        super().__init__(shape, bins, channels=2)
        self.seen: list[Tensor] = []

    def forward(self, image: Tensor) -> Tensor:
        self.seen.append(image.detach())
        return super().forward(image)


@pytest.mark.parametrize("binarise", [True, False])
def test_projections_are_binarised_if_asked(binarise: bool) -> None:
    predictor, _ = trained(Predicted(Spy, steps=3, batch=16, binarise=binarise), *quadrants())
    assert isinstance(predictor, Spy) and predictor.seen[0].shape == (16, 1, 16, 16)
    assert (set(torch.cat(predictor.seen).unique().tolist()) == {0.0, 1.0}) == binarise


def test_prediction_by_chunks_is_prediction() -> None:
    predictor, images = Spy((1, 16, 16), 4).eval(), quadrants(10)[0]
    whole, parts = predict(predictor, images), predict(predictor, images, batch=3)
    assert [len(seen) for seen in predictor.seen] == [10, 3, 3, 3, 1]
    torch.testing.assert_close(whole, parts)
    torch.testing.assert_close(whole.sum(1), torch.ones(10))
    assert not whole.requires_grad


# Settings


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"starts": (0.5, 0.2)}, "increasing"),
        ({"starts": (0.2, 0.2)}, "increasing"),
        ({"starts": (0.0, 0.5)}, "between 0 and 1"),
        ({"starts": (0.5, 1.0)}, "between 0 and 1"),
        ({"draw": "softmax"}, "choose one of argmax, posterior"),
        ({"steps": 0}, "steps=0"),
        ({"images": 0}, "images=0"),
        ({"batch": 0}, "batch=0"),
        ({"clusters": 0}, "clusters=0"),
    ],
    ids=str,
)
def test_wrong_settings_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        Predicted(SMALL, **wrong)


@pytest.mark.parametrize("starts", [(), (0.5,), (0.1, 0.2, 0.9)])
def test_any_number_of_rounds(starts: tuple[float, ...]) -> None:
    assert Predicted(SMALL, starts).starts == starts


def test_balanced_means_reach_their_target_and_rows_stay_probabilities() -> None:
    p = torch.rand(200, 4, generator=generator_at(0)) * torch.tensor([8.0, 1.0, 1.0, 0.5])
    p = p / p.sum(1, keepdim=True)
    assert torch.allclose(balanced(p, 1.0).mean(0), torch.full((4,), 0.25), atol=1e-3)
    half = p.mean(0).sqrt() / p.mean(0).sqrt().sum()
    assert torch.allclose(balanced(p, 0.5).mean(0), half, atol=1e-3)
    assert torch.allclose(balanced(p, 0.0), p, atol=1e-5)
    assert torch.allclose(balanced(p, 0.7).sum(1), torch.ones(200))


# Windows


def around(first: int, length: int, ways: int = 8, seed: int = 0) -> Tensor:
    """Odds of images whose ways are the `length` after `first`: 0.6 for the right one, noise elsewhere."""
    rng = generator_at(seed, 0, "around")
    true = (first + torch.randint(length, (300,), generator=rng)) % ways
    odds = torch.rand(300, ways, generator=rng)
    odds = 0.4 * odds / odds.sum(1, keepdim=True)
    return odds.scatter_add(1, true[:, None], torch.full((300, 1), 0.6))


@pytest.mark.parametrize("first", [0, 3, 6])
def test_the_run_of_ways_that_were_taken_is_found_over_the_end_too(first: int) -> None:
    assert likeliest_run(around(first, 4), 4).tolist() == [(first + k) % 8 for k in range(4)]
    assert sorted(likeliest_run(around(first, 4), 20).tolist()) == list(range(8))


def test_what_is_estimated_keeps_to_the_window() -> None:
    settings = Predicted(SMALL, window=4, balance=1.0)
    found = estimated(around(6, 4), settings)
    assert found[:, 2:6].eq(0).all() and torch.allclose(found.sum(1), torch.ones(300))
    torch.testing.assert_close(found.mean(0)[[6, 7, 0, 1]], torch.full((4,), 0.25), atol=1e-3, rtol=0)
    whole = estimated(around(6, 4), Predicted(SMALL))
    torch.testing.assert_close(whole, around(6, 4))


def test_an_image_that_fits_nowhere_in_the_window_still_gets_a_way() -> None:
    odds = torch.tensor([[1.0, 0, 0, 0]] * 9 + [[0, 0, 1.0, 0]])
    found = estimated(odds, Predicted(SMALL, window=2))
    assert torch.isfinite(found).all() and torch.allclose(found.sum(1), torch.ones(10))


def test_a_window_of_no_ways_makes_no_sense() -> None:
    with pytest.raises(UserError, match="window"):
        Predicted(SMALL, window=0)
