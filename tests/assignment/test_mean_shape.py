"""The mean shape behind the silhouettes: unknown views, along the plane of symmetry and not across it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.assignment.mean_shape import (
    MeanShapeInitialiser,
    mismatch,
    pooled,
    projections,
    squares,
    uneven_ball,
)
from unproject.data import Collection, birds, cars, chairs, observe
from unproject.metrics import view_accuracy
from unproject.ops.rotation import quarter_turn
from unproject.projections.line_integral import directions
from unproject.projections.silhouette import Silhouette, azimuth_bins

VIEWS = 8
AROUND = azimuth_bins(VIEWS, Silhouette(size=16, rule="absorption", density=2.0))
QUICK = MeanShapeInitialiser(mirror=True, images=400, tries=1, iterations=150)


def seen(make: Callable[..., Tensor], seed: int = 3) -> tuple[Tensor, Tensor]:
    """Silhouettes (600, 1, 16, 16) of a family's shapes, and their views."""
    collection = observe(Collection(make(200, 16, seed=seed)), AROUND, 3, seed)
    assert collection.latents is not None
    return collection.items, collection.latents["view"].long()


@pytest.mark.parametrize(
    ("make", "least"), [(chairs, 0.45), (birds, 0.4), (cars, 0.3)], ids=["chairs", "birds", "cars"]
)
def test_views_are_initialised_and_the_plane_of_symmetry_is_found(make: Callable[..., Tensor], least: float) -> None:
    items, true = seen(make)
    odds = QUICK(AROUND, items, seed=0)
    torch.testing.assert_close(odds.sum(1), torch.ones(600), atol=1e-4, rtol=0)
    torch.testing.assert_close(odds.mean(0), torch.full((VIEWS,), 1 / VIEWS), atol=0.02, rtol=0)
    found = view_accuracy(odds.argmax(1), true, VIEWS)
    assert found.exact > least > 1.5 * found.chance_exact
    assert found.gauge.turn % (VIEWS // 2) == 0, "lies across the plane of symmetry"


def test_initial_views_are_a_function_of_the_seed() -> None:
    items, _ = seen(chairs)
    hasty = replace(QUICK, iterations=5)
    odds = hasty(AROUND, items, seed=0)
    assert torch.equal(odds, hasty(AROUND, items, seed=0))
    assert not torch.equal(odds, hasty(AROUND, items, seed=1))


def test_an_elongated_shape_that_lies_across_the_plane_of_symmetry_explains_less() -> None:
    items, true = seen(cars)
    pictures = pooled(items)
    across = QUICK.fit(AROUND, pictures, uneven_ball(generator_at(0)), QUICK.hot, 0)
    along = QUICK.fit(AROUND, pictures, quarter_turn(across.logits[None], 1)[0], QUICK.warm, 0)
    assert along.log_likelihood > across.log_likelihood + 0.05
    for fitted, turn in ((across, VIEWS // 4), (along, 0)):
        told = mismatch(pictures, AROUND, fitted.logits, 0).argmin(1)
        assert view_accuracy(told, true, VIEWS).gauge.turn % (VIEWS // 2) == turn


def test_a_fit_explains_more_than_its_start_and_is_symmetric() -> None:
    pictures = pooled(seen(chairs)[0])
    ball = uneven_ball(generator_at(0))
    fitted = QUICK.fit(AROUND, pictures, ball, QUICK.hot, 0)
    assert torch.equal(fitted.logits, fitted.logits.flip(0))
    before, after = (mismatch(pictures, AROUND, logits, 0).min(1).values.mean() for logits in (ball, fitted.logits))
    assert after < 0.6 * before
    free = replace(QUICK, mirror=False, iterations=2).fit(AROUND, pictures, ball, QUICK.hot, 0)
    assert not torch.allclose(free.logits, free.logits.flip(0), atol=0.01)


def test_mismatch_is_the_mean_square_over_each_views_prior() -> None:
    pictures, logits = pooled(torch.rand(5, 1, 32, 32, generator=generator_at(1))), uneven_ball(generator_at(0))
    there = projections(AROUND, logits, generator_at(2))
    assert there.shape == (VIEWS, 256)
    every = torch.stack([torch.stack([(y - s).square().sum() for s in there]) for y in pictures])
    torch.testing.assert_close(squares(pictures, there), every)
    draws = [projections(AROUND, logits, generator_at(7, draw, "looks at the fitted shape")) for draw in range(8)]
    assert not torch.allclose(draws[0], draws[1], atol=1e-3)
    torch.testing.assert_close(mismatch(pictures, AROUND, logits, 7), sum(squares(pictures, s) for s in draws) / 8)


def test_what_are_no_silhouettes_is_refused() -> None:
    with pytest.raises(UserError, match="takes silhouettes"):
        MeanShapeInitialiser()(directions(4, 0.02), torch.zeros(4, 1, 16), 0)
    with pytest.raises(UserError, match="takes silhouettes"):
        MeanShapeInitialiser()(directions(4, 0.02), torch.zeros(4, 1, 16, 16), 0)
    with pytest.raises(UserError, match="takes silhouettes"):
        MeanShapeInitialiser()(AROUND, torch.zeros(4, 1, 16, 32), 0)
    with pytest.raises(UserError, match="takes silhouettes"):
        MeanShapeInitialiser()(AROUND, torch.zeros(4, 3, 16, 16), 0)
    for wrong in ({"images": 0}, {"cold": 0.0}, {"warm": 99.0}, {"balance": 1.5}):
        with pytest.raises(UserError, match="at least 1 image"):
            MeanShapeInitialiser(**wrong)
