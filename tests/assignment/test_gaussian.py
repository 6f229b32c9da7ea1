"""The Gaussian behind the lines: its formulas against torch's, EM's law, and directions that are unknown to it."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.distributions import MultivariateNormal

from unproject._random import generator_at
from unproject._types import UserError
from unproject.assignment.gaussian import (
    Expectation,
    GaussianInitialiser,
    blob_centres,
    blob_projections,
    expect,
    fit,
    isotropic,
    maximise,
    opposite,
)
from unproject.data import Collection, digits, observe
from unproject.metrics import view_accuracy
from unproject.projections.line_integral import directions
from unproject.projections.silhouette import Silhouette, azimuth_bins

SIZE, WAYS = 16, 6
AROUND = directions(WAYS, 0.02, whole=True)


@pytest.fixture(scope="module")
def ops() -> Tensor:
    return blob_projections(AROUND, SIZE, seed=0)


@pytest.fixture(scope="module")
def measured() -> tuple[Tensor, Tensor]:
    """Line integrals (1500, 1, 16) of the embedded digits, and their directions."""
    seen = observe(Collection(digits(SIZE)[:1500]), AROUND[:WAYS], 1, seed=3)
    assert seen.latents is not None
    return seen.items, seen.latents["view"].long()


def test_half_a_turn_takes_each_blob_to_its_opposite(ops: Tensor) -> None:
    centres = blob_centres(SIZE)
    turned = opposite(len(centres))
    torch.testing.assert_close(centres[turned], -centres)
    # ... which a direction sees as the opposite direction, and that one reads it backwards.
    torch.testing.assert_close(ops[:WAYS][:, :, turned], ops[:WAYS].flip(1), atol=1e-5, rtol=0)
    torch.testing.assert_close(ops[WAYS:], ops[:WAYS].flip(1), atol=1e-5, rtol=0)


def test_log_likelihood_is_that_of_the_normal_distribution(ops: Tensor, measured: tuple[Tensor, Tensor]) -> None:
    lines = measured[0][:50, 0]
    images = isotropic(ops, lines, 0.1, seed=0)
    found = expect(lines, ops, images).log_likelihood
    for k in (0, 5):
        covariance = ops[k] @ images.covariance @ ops[k].T + 0.1**2 * torch.eye(SIZE)
        normal = MultivariateNormal(ops[k] @ images.mean, covariance)
        constant = SIZE / 2 * math.log(2 * math.pi)
        torch.testing.assert_close(found[:, k].double(), normal.log_prob(lines.double()) + constant, atol=1e-3, rtol=0)


def test_a_step_is_the_mean_and_covariance_of_the_posteriors(ops: Tensor, measured: tuple[Tensor, Tensor]) -> None:
    """Line by line and direction by direction, by Bayes' rule for Gaussians in information form."""
    lines = measured[0][:7, 0]
    some = ops[:2]
    images = isotropic(some, lines, 0.1, seed=1)
    weights = torch.rand(7, 2, generator=generator_at(0))
    weights = weights / weights.sum(1, keepdim=True)
    got = maximise(lines, some, images, expect(lines, some, images), weights)

    means, covariances = [], []
    for k in range(2):
        precision = images.covariance.inverse() + some[k].T @ some[k] / 0.1**2
        covariances.append(precision.inverse())
        residual = lines.double() - some[k] @ images.mean
        means.append(images.mean + residual @ some[k] @ covariances[k] / 0.1**2)
    w = weights.double()
    mean = sum((w[:, k, None] * means[k]).sum(0) for k in range(2)) / 7
    spread = torch.zeros_like(images.covariance)
    for k in range(2):
        off = means[k] - mean
        spread += (w[:, k, None] * off).T @ off / 7 + w[:, k].mean() * covariances[k]
    scale = float(images.covariance.abs().max())
    torch.testing.assert_close(got.mean, mean, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(got.covariance, spread, atol=1e-4 * scale, rtol=0)


def test_likelihood_never_falls_while_directions_stay(ops: Tensor, measured: tuple[Tensor, Tensor]) -> None:
    lines, true = measured[0][:400, 0], measured[1][:400]
    views = torch.nn.functional.one_hot(true, WAYS).float()
    images = isotropic(ops[:WAYS], lines, 0.03, seed=0)
    last = -math.inf
    for _ in range(12):
        likelihood = float((views * expect(lines, ops[:WAYS], images).log_likelihood).sum())
        assert likelihood > last
        last = likelihood
        images, _ = fit(lines, ops[:WAYS], images, 1, views=views)


def test_even_images_do_not_tell_a_line_from_itself_backwards(ops: Tensor, measured: tuple[Tensor, Tensor]) -> None:
    lines = measured[0][:300, 0]
    images, _ = fit(lines, ops[:WAYS], isotropic(ops, lines, 0.05, seed=0), 5, heat=5.0, even=True)
    found: Expectation = expect(lines, ops[:WAYS], images)
    backwards = expect(lines.flip(1), ops[:WAYS], images)
    torch.testing.assert_close(found.log_likelihood, backwards.log_likelihood, atol=0.01, rtol=0)
    odd, _ = fit(lines, ops[:WAYS], images, 5)
    gap = expect(lines, ops[:WAYS], odd).log_likelihood - expect(lines.flip(1), ops[:WAYS], odd).log_likelihood
    assert float(gap.abs().max()) > 1


def test_directions_of_digits_are_initialised() -> None:
    seen = observe(Collection(digits(32)[:1500]), AROUND[:WAYS], 1, seed=3)
    assert seen.latents is not None
    items, true = seen.items, seen.latents["view"].long()
    initialiser = GaussianInitialiser(lines=1000, annealed=120, free=20, heat=20.0)
    odds = initialiser(AROUND, items, seed=0)
    taken = odds.sum(0) > 0
    assert odds.shape == (1500, 2 * WAYS) and torch.allclose(odds.sum(1), torch.ones(1500), atol=1e-4)
    assert int(taken.sum()) == WAYS and int((taken != taken.roll(1)).sum()) == 2  # one run of them
    shares = odds.mean(0)[taken]
    torch.testing.assert_close(shares, torch.full((WAYS,), 1 / WAYS), atol=0.02, rtol=0)
    within = view_accuracy(odds.argmax(1) % WAYS, true, WAYS, half=True)
    assert within.exact > 1.6 * within.chance_exact and within.within_one > 0.65
    assert torch.equal(odds, initialiser(AROUND, items, seed=0))


def test_what_are_no_lines_around_a_whole_turn_is_refused(measured: tuple[Tensor, Tensor]) -> None:
    with pytest.raises(UserError, match="around a turn"):
        GaussianInitialiser()(AROUND[:5], measured[0], 0)
    with pytest.raises(UserError, match="line integrals"):
        GaussianInitialiser()(azimuth_bins(4, Silhouette()), torch.zeros(4, 1, 8, 8), 0)
    with pytest.raises(UserError, match="at least 1"):
        GaussianInitialiser(lines=0)
