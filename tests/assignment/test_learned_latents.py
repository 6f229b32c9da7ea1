"""Learned latents: draws, limits, gradients, what they replace, and that they find a distribution."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch

import unproject as up
from unproject.assignment import LearnedLatent, LearnedLatents
from unproject.training.distribution import Distribution

ELEVATION = LearnedLatent("elevation", mean=0.2, spread=0.1, low=-0.5, high=1.2)


def begun(*settings: LearnedLatent) -> LearnedLatents:
    latents = LearnedLatents(settings)
    latents.advance(1.0)
    return latents


def rng(seed: int = 0) -> torch.Generator:
    return torch.Generator().manual_seed(seed)


def test_draws_have_the_mean_and_the_spread() -> None:
    drawn = begun(ELEVATION).draw(20_000, rng())["elevation"]
    assert drawn.shape == (20_000,)
    assert abs(drawn.mean().item() - 0.2) < 3e-3 and abs(drawn.std().item() - 0.1) < 3e-3


def test_draws_stay_within_the_limits() -> None:
    latents = begun(LearnedLatent("perspective", mean=0.1, spread=0.3, low=0.0, high=0.4))
    drawn = latents.draw(1000, rng())["perspective"].detach()
    assert 0.0 < drawn.min() < 0.01 and drawn.max() == pytest.approx(0.4)
    assert len(drawn.unique()) > 700  # below the lower limit none became the limit


def test_negligible_ones_are_zero_and_stay_so() -> None:
    latents = begun(LearnedLatent("elevation", mean=-0.02, spread=0.02, negligible=0.05))
    drawn = latents.draw(3, rng())["elevation"]
    assert drawn.tolist() == [0.0] * 3 and not drawn.requires_grad
    latents = begun(LearnedLatent("elevation", mean=-0.04, spread=0.02, negligible=0.05))
    assert latents.draw(3, rng())["elevation"].requires_grad


def test_latents_of_one_panel_are_independent() -> None:
    drawn = begun(ELEVATION, LearnedLatent("roll", mean=0.0, spread=0.1)).draw(5000, rng())
    both = torch.stack([drawn["elevation"], drawn["roll"]])
    assert abs(torch.corrcoef(both)[0, 1].item()) < 0.05


def test_a_fixed_mean_has_no_gradient_and_its_spread_has() -> None:
    latents = begun(LearnedLatent("roll", mean=0.0, spread=0.1, fixed_mean=True))
    latents.draw(100, rng())["roll"].square().mean().backward()
    found = dict(latents.named_parameters())
    assert found["latents.roll.mean"].grad is None
    assert found["latents.roll.log_spread"].grad is not None and found["latents.roll.log_spread"].grad.item() > 0


@pytest.mark.parametrize(
    "bad",
    [{"spread": 0.0}, {"rate": 0.0}, {"mean": 2.0}, {"name": "a.b"}, {"begin": 1.0}, {"low": 0.1, "negligible": 0.05}],
)
def test_senseless_settings_are_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(up.UserError, match="give a name, a positive spread and rate"):
        LearnedLatent(**{"name": "elevation", "mean": 0.2, "spread": 0.1, "low": -0.5, "high": 1.2} | bad)


def panel_of(elevation: float, count: int = 96, size: int = 16) -> up.Panel:
    """Return chairs seen from one elevation, and observations that know nothing of it."""
    x = up.data.chairs(count, size, seed=1)
    azimuth = torch.rand(count, generator=rng(2)) * 2 * math.pi
    silhouette = up.Silhouette(size=size, rule="absorption", density=2.0)
    pictures = silhouette(x, azimuth=azimuth, elevation=torch.full((count,), elevation))
    views = up.projections.azimuth_bins(4, silhouette)
    return up.Panel(views, up.Collection(pictures), up.Predicted(), learned=(ELEVATION,))


def test_a_learned_latent_takes_the_place_of_the_prior() -> None:
    panel = panel_of(0.0)
    state = panel.assignment.begin(panel, seed=0)
    assert state.learned is not None
    state.learned.advance(0.0)
    x, views = up.data.chairs(4, 16), torch.zeros(4, dtype=torch.long)
    level, tilted = panel.project(x, views, rng()), state.observe(x, views, rng())
    assert not torch.allclose(level, tilted, atol=0.05)
    assert tilted.requires_grad and not level.requires_grad


def test_gradient_finds_the_distribution_of_the_pictures() -> None:
    """The shapes are the true ones, so only elevation is unknown: the mean picture of each is matched."""
    count, size = 48, 16
    x = up.data.chairs(count, size, seed=1)
    silhouette = up.Silhouette(size=size, rule="absorption", density=2.0)
    azimuth = torch.rand(count, generator=rng(2)) * 2 * math.pi
    true = silhouette(x, azimuth=azimuth, elevation=0.5 + 0.05 * torch.randn(count, generator=rng(3)))
    latents = begun(LearnedLatent("elevation", 0.1, 0.15, -0.5, 1.2, rate=0.05))
    for step in range(120):
        made = silhouette(x, azimuth=azimuth, elevation=latents.draw(count, rng(step))["elevation"])
        (made - true).square().mean().backward()
        latents.update(Distribution("cpu"))
    mean, spread = latents.log()["elevation"]
    assert abs(mean - 0.5) < 0.05 and spread < 0.1


@pytest.mark.parametrize("names", [["elevaton"], ["elevation", "elevation"]])
def test_a_panel_takes_latents_of_its_projection_once(names: list[str]) -> None:
    panel = panel_of(0.0, count=8)
    learned = tuple(LearnedLatent(name, 0.1, 0.1) for name in names)
    with pytest.raises(up.UserError, match="give latents of the projection"):
        up.Panel(panel.observations, panel.data, panel.assignment, learned=learned)


def test_names_of_a_modules_own_are_free() -> None:
    assert begun(LearnedLatent("adam", 0.0, 0.1), LearnedLatent("settings", 0.0, 0.1)).draw(2, rng()).keys() == {
        "adam",
        "settings",
    }
