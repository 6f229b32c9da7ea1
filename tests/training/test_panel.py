"""Panels: looks that share a projection and an image shape share a discriminator, a head each."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
import torch
from comparing import differences, final
from torch import Tensor
from toy import BINS, CHAIRS, SIZE, toy

from unproject._random import generator_at
from unproject._types import UserError
from unproject.adversarial.assignment import Known
from unproject.adversarial.penalties import R1R2
from unproject.data import Collection, chairs
from unproject.networks import Discriminator
from unproject.projections.base import Projection
from unproject.projections.observation import Observation
from unproject.projections.priors import Product, Uniform
from unproject.projections.silhouette import Silhouette, azimuth_bins
from unproject.training import Recipe, resume, train
from unproject.training.loop import Loop
from unproject.training.panel import build_panels


@dataclass(frozen=True)
class Plan(Projection):
    """Seen from above, `scale` times as bright."""

    scale: float = 1.0

    def forward(self, x: Tensor) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        return self.scale * x.amax(2)[:, None]


class Unequal(Projection):
    """No two of these are equal: each is a way of its own."""

    def forward(self, x: Tensor) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        return x.amax(2)[:, None]


def looking(*projections: Projection, count: int = 6) -> Recipe:
    """A recipe with one look for each projection and images that it made."""
    shapes = chairs(count, SIZE)
    looks = [(Observation(f"look {i}", p, Product()), Collection(p(shapes))) for i, p in enumerate(projections)]
    return toy(steps=2, views="known").replace(looks=looks, discriminator=lambda shape, heads: heads)


def test_equal_projections_share_a_panel_and_others_do_not() -> None:
    panels = build_panels(looking(Plan(), Plan(0.5), Plan(), Unequal(), Unequal()))
    assert [len(panel.observations) for panel in panels] == [2, 1, 1, 1]
    assert [panel.observations[0].name for panel in panels] == ["look 0", "look 1", "look 3", "look 4"]
    assert [panel.discriminator for panel in panels] == [2, 1, 1, 1]
    assert panels[0].ways.tolist() == panels[0].heads.tolist() == [0] * 6 + [1] * 6


def test_images_of_another_size_are_judged_apart() -> None:
    recipe = looking(Plan(), Plan())
    (observation, seen), (other, _) = recipe.looks
    small = Collection(seen.items[:, :, ::2, ::2])
    assert len(build_panels(recipe.replace(looks=[(observation, seen), (other, small)]))) == 2


def test_an_observation_counts_as_often_as_its_weight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """loss_g = Σ_i w_i loss_i, in the first update, before which nothing differs."""
    losses, update = [], Loop._update_generator  # pyright: ignore[reportPrivateUsage]

    def spy(self: Loop, *arguments: Any) -> Tensor:
        losses.append(update(self, *arguments))
        return losses[-1]

    monkeypatch.setattr(Loop, "_update_generator", spy)

    def first_loss(*weights: float) -> float:
        train(weighted(*weights), tmp_path / str(weights), quiet=True)
        return losses[-1].item()

    even, first, second = first_loss(1, 1), first_loss(3, 1), first_loss(1, 3)
    assert first + second == pytest.approx(4 * even, rel=1e-4) and abs(first - second) > 1e-4


def weighted(*weights: float, field: str = "weight") -> Recipe:
    looks = [
        (replace(o, **{field: weight}), seen)
        for (o, seen), weight in zip(looking(Plan(), Plan(0.5)).looks, weights, strict=True)
    ]
    return toy(steps=1, views="known").replace(looks=looks)


def test_a_discriminator_is_smoothed_as_its_observation_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The penalty is Σ_i s_i penalty_i, in the first update, before which nothing differs."""
    found, update = [], Loop._update_discriminators  # pyright: ignore[reportPrivateUsage]

    def spy(self: Loop, *arguments: Any) -> dict[str, Tensor]:
        losses = update(self, *arguments)
        found.append(losses["penalty"].item())
        return losses

    monkeypatch.setattr(Loop, "_update_discriminators", spy)
    for smoothing in ((1, 1), (3, 1), (1, 3)):
        recipe = weighted(*smoothing, field="smoothing").replace(penalty=R1R2(1.0, every=1))
        train(recipe, tmp_path / str(smoothing), quiet=True)
    even, first, second = found
    assert first + second == pytest.approx(4 * even, rel=1e-4) and abs(first - second) > 1e-6 * even


def test_balanced_panels_pull_alike(tmp_path: Path) -> None:
    """A first update with balance is one with weights divided by the pulls it measured, which are gradients' norms."""
    balanced = final(train(weighted(1, 2).replace(balance=1), tmp_path / "balanced", quiet=True).path)
    pulls = [balanced[f"panels/{k}/pull"].item() for k in range(2)]
    assert pulls[0] != pulls[1] and min(pulls) > 0
    plain = final(train(weighted(1 / pulls[0], 2 / pulls[1]), tmp_path / "plain", quiet=True).path)
    assert plain["panels/0/pull"] == 1
    moments = [name for name in plain if name.startswith("generator_optimiser") and name.endswith("exp_avg")]
    for name in moments:
        assert torch.allclose(plain[name], balanced[name], rtol=1e-4, atol=1e-7)
    alone = final(train(weighted(1, 1e-9), tmp_path / "alone", quiet=True).path)
    # The first moment is 1 - β₁ = 1 of the gradient.
    norm = torch.cat([alone[name].flatten() for name in moments]).norm().item()
    assert norm == pytest.approx(pulls[0], rel=1e-4)


def test_one_panel_alone_has_nothing_to_balance(tmp_path: Path) -> None:
    recipe = toy(steps=2, views="known")
    assert final(train(recipe.replace(balance=1), tmp_path / "run", quiet=True).path)["panels/0/pull"] == 1
    with pytest.raises(UserError, match="balance=-1: give steps between two measurements, or 0"):
        recipe.replace(balance=-1)


def test_ways_that_one_discriminator_judges_have_one_weight() -> None:
    (first, seen), (other, also) = looking(Plan(), Plan()).looks
    heavy = Observation(other.name, other.projection, other.prior, 2.0)
    with pytest.raises(UserError, match="'look 0', 'look 1' share .* one weight"):
        build_panels(looking(Plan()).replace(looks=[(first, seen), (heavy, also)]))
    smooth = replace(other, smoothing=2.0)
    with pytest.raises(UserError, match="'look 0', 'look 1' share .* one smoothing"):
        build_panels(looking(Plan()).replace(looks=[(first, seen), (smooth, also)]))
    with pytest.raises(UserError, match="smoothing=-1: must be positive"):
        Observation("dark", Plan(), Product(), 1.0, -1.0)
    with pytest.raises(UserError, match="weight=0: must be positive"):
        Observation("dark", Plan(), Product(), 0.0)


def test_each_image_is_paired_with_its_own_way_of_looking() -> None:
    """With bins as narrow as nothing, what a panel sees is what each observation sees."""
    silhouette, shapes = Silhouette(size=SIZE), chairs(4, SIZE)
    angles = [0.3, 1.2, 2.9]
    level = Uniform("elevation", 0, 0)
    ways = [Observation(f"{a}", silhouette, Product(Uniform("azimuth", a, a), level)) for a in angles]
    blank = Collection(torch.zeros(4, 1, SIZE, SIZE))
    (panel,) = build_panels(toy(steps=1, views="known").replace(looks=[(way, blank) for way in ways]))
    way = torch.tensor([2, 0, 1, 0])
    seen = panel.look(shapes, way, generator_at(0))
    expected = silhouette(shapes, azimuth=torch.tensor(angles)[way], elevation=torch.zeros(4))
    assert torch.allclose(seen, expected, atol=1e-6)


@pytest.mark.parametrize("balance", [0, 2])
def test_several_projections_train_together_and_resume(tmp_path: Path, balance: int) -> None:
    recipe = looking(Plan(), Plan(0.5), Unequal()).replace(discriminator=lambda s, h: Discriminator(s, h, channels=4))
    recipe = recipe.replace(checkpoint_every=2, balance=balance)
    whole = train(recipe.replace(steps=4), tmp_path / "whole", quiet=True).path
    train(recipe, tmp_path / "half", quiet=True)
    resume(recipe.replace(steps=4), tmp_path / "half", quiet=True)
    assert differences(whole, tmp_path / "half") == []
    assert {name.split("/")[1] for name in final(whole) if name.startswith("panels/")} == {"0", "1", "2"}


def test_unknown_views_start_at_random_and_with_one_head() -> None:
    (panel,) = build_panels(toy(steps=1))
    assert len(panel.observations) == BINS and len(panel.items) == 2 * CHAIRS
    assert panel.ways.unique().tolist() == list(range(BINS)) and panel.heads.unique().tolist() == [0]


def test_predicted_assignment_needs_one_collection_and_several_looks() -> None:
    recipe = toy(steps=1)
    ways, (_, seen) = azimuth_bins(2, Silhouette(size=SIZE)), recipe.looks[0]
    with pytest.raises(UserError, match="at least two looks"):
        build_panels(recipe.replace(looks=[(ways[0], seen)]))
    with pytest.raises(UserError, match="same collection"):
        build_panels(recipe.replace(looks=[(ways[0], seen), (ways[1], Collection(seen.items))]))
    with pytest.raises(UserError, match="share one projection"):
        build_panels(recipe.replace(looks=[(ways[0], seen), (Observation("plan", Plan(), Product()), seen)]))
    assert len(build_panels(recipe.replace(assignment=Known()))) == 1
