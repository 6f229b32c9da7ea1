"""The recipes of shapes: what each row of their table looks at, who assigns, and who judges."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from unproject.adversarial.assignment import Known, Predicted
from unproject.adversarial.mean_shape_start import MeanShapeStart
from unproject.training.panel import build_panels

from unproject._types import UserError
from unproject.adversarial.losses import Hinge, Relativistic, Wasserstein
from unproject.adversarial.penalties import R1R2, GradientPenalty
from unproject.adversarial.regularisers import Solid
from unproject.data import Collection
from unproject.networks import LowRankGenerator, VoxelGenerator
from unproject.projections.base import Identity
from unproject.projections.silhouette import Silhouette, azimuth_bins
from unproject.recipes import shapes as module
from unproject.recipes.pairing import by_known_view
from unproject.recipes.shapes import shapes, shapes_paper
from unproject.training.recipe import Recipe

RECIPES: dict[str, Callable[..., Recipe]] = {"shapes": shapes, "shapes-paper": shapes_paper}
SMALL = {"size": 16, "looks_per_shape": 8}

both = pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)


# The table


@both
def test_predicted_views(recipe: Callable[..., Recipe], volumes: Path) -> None:
    made = recipe(data=volumes, views="predicted", **SMALL)
    assert isinstance(made.assignment, Predicted)
    assert [o.name for o, _ in made.looks] == [f"azimuth-{k:02d}" for k in range(16)]
    assert len({id(collection) for _, collection in made.looks}) == 1
    assert made.looks[0][1].items.shape == (6 * 8, 1, 16, 16)


@both
def test_known_views(recipe: Callable[..., Recipe], volumes: Path) -> None:
    made = recipe(data=volumes, views="known", **SMALL)
    assert isinstance(made.assignment, Known)
    assert sum(len(collection) for _, collection in made.looks) == 6 * 8
    for observation, collection in made.looks:
        assert collection.latents is not None
        assert observation.prior.contains(collection.latents).all()
        assert {f"azimuth-{int(k):02d}" for k in collection.latents["view"]} == {observation.name}


@both
def test_a_single_look(recipe: Callable[..., Recipe], volumes: Path) -> None:
    made = recipe(data=volumes, views="single", **SMALL)
    ((observation, collection),) = made.looks
    azimuths = {"azimuth": torch.linspace(-10, 10, 50), "elevation": torch.zeros(50)}
    assert isinstance(made.assignment, Known) and observation.prior.contains(azimuths).all()
    assert collection.items.shape == (6 * 8, 1, 16, 16)


@both
def test_direct_training(recipe: Callable[..., Recipe], volumes: Path) -> None:
    made = recipe(data=volumes, views="direct", **SMALL)
    ((observation, collection),) = made.looks
    assert isinstance(made.assignment, Known) and isinstance(observation.projection, Identity)
    assert collection.items.shape == (6, 16, 16, 16)
    assert made.discriminator.keywords["volumetric"]  # type: ignore[attr-defined]


@pytest.mark.parametrize("views, solid", [("predicted", True), ("known", True), ("single", True), ("direct", False)])
def test_only_what_is_seen_in_silhouette_needs_to_be_told_to_be_solid(views: Any, solid: bool, volumes: Path) -> None:
    made = shapes(data=volumes, views=views, solid=0.3, **SMALL)
    assert made.regulariser == (Solid(0.3, 0.03) if solid else None)
    assert shapes(data=volumes, views=views, solid=0.0, **SMALL).regulariser is None


@pytest.mark.parametrize("views, heads", [("predicted", 16), ("single", 1), ("direct", 1)])
def test_one_head_a_way_of_looking(views: Any, heads: int, volumes: Path) -> None:
    (panel,) = build_panels(shapes(data=volumes, views=views, **SMALL))
    assert len(panel.discriminator.last.weight) == heads  # type: ignore[union-attr,arg-type]
    logits = panel.discriminator(panel.items[:3], panel.heads[:3])
    assert logits.shape == (3,)


def test_all_arms_see_the_same_silhouettes(volumes: Path) -> None:
    seen = [shapes(data=volumes, views=views, **SMALL) for views in ("predicted", "known", "single")]
    sums = [torch.cat([c.items for c in {id(c): c for _, c in made.looks}.values()]).sum() for made in seen]
    torch.testing.assert_close(sums, [sums[0]] * 3)


@both
def test_bands_of_elevation(recipe: Callable[..., Recipe], volumes: Path) -> None:
    made = recipe(data=volumes, views="known", bins=4, bands=3, **{**SMALL, "looks_per_shape": 16})
    elevations = torch.cat([c.latents["elevation"] for _, c in made.looks if c.latents is not None])
    assert len(made.looks) == 12 and len(elevations) == 6 * 16
    assert elevations.abs().max().rad2deg() <= 22.5 and (elevations.abs().rad2deg() > 7.5).float().mean() > 0.4
    ((observation, _),) = recipe(data=volumes, views="single", bins=4, bands=3, **SMALL).looks
    asked = {"azimuth": torch.ones(3), "elevation": torch.tensor([-22.0, 0.0, 23.0]).deg2rad()}
    assert observation.prior.contains(asked).tolist() == [True, True, False]


@pytest.mark.parametrize("views", ["predicted", "known", "single", "direct"])
def test_flips_double_what_is_learned_from(views: Any, volumes: Path) -> None:
    plain, doubled = (shapes(data=volumes, views=views, flips=flips, **SMALL) for flips in (False, True))
    counts = [len(build_panels(made)[0].items) for made in (plain, doubled)]
    assert counts[1] == 2 * counts[0]


@pytest.mark.parametrize("wrong", [{"bins": 0}, {"bands": 0}], ids=str)
def test_no_bins_are_refused(wrong: dict[str, int], volumes: Path) -> None:
    with pytest.raises(UserError, match="give at least one of each"):
        shapes(data=volumes, **SMALL, **wrong)


# Choices


def test_the_modern_choices(volumes: Path) -> None:
    made = shapes(data=volumes, rank=4, channels=16, mirror=True, gamma=3, rounds=2, **SMALL)
    generator = made.generator()
    assert isinstance(generator, LowRankGenerator) and generator.mirror
    assert generator.sample(1).shape == (1, 16, 16, 16)
    assert (made.loss, made.penalty) == (Relativistic(), R1R2(3, every=8))
    assert isinstance(made.assignment, Predicted) and len(made.assignment.starts) == 2


@pytest.mark.parametrize("mirror", [True, False])
def test_a_guess_has_the_symmetry_of_what_is_made(mirror: bool, volumes: Path) -> None:
    made = shapes(data=volumes, guess=True, mirror=mirror, balance=0.3, **SMALL)
    assert isinstance(made.assignment, Predicted)
    assert made.assignment.first == MeanShapeStart(mirror=mirror, balance=0.3)
    plain = shapes(data=volumes, **SMALL).assignment
    assert isinstance(plain, Predicted) and plain.first is None


def test_the_seeds_choices(volumes: Path) -> None:
    made = shapes_paper(data=volumes, channels=16, **SMALL)
    generator = made.generator()
    assert isinstance(generator, VoxelGenerator) and generator.code_size == 256 and generator.truncation is None
    assert (made.loss, made.penalty, made.discriminator_steps) == (Wasserstein(), GradientPenalty(10), 2)
    assert (made.generator_optimiser.rate, made.generator_optimiser.beta1) == (1e-4, 0.5)
    assert made.discriminator.keywords["spectral"]  # type: ignore[attr-defined]
    assert isinstance(made.assignment, Predicted) and made.assignment.binarise and made.assignment.steps == 100_000
    assert made.looks[0][0].projection == Silhouette(size=16)


def test_the_released_choices(volumes: Path) -> None:
    made = shapes_paper(data=volumes, channels=16, released=True, loss="hinge", clusters=8, **SMALL)
    assert made.generator().truncation == 0.75
    assert made.looks[0][0].projection == Silhouette(size=16, rule="alpha", viewport=1.4)
    assert made.loss == Hinge() and made.penalty is None
    assert isinstance(made.assignment, Predicted) and made.assignment.clusters == 8


@both
def test_budgets(recipe: Callable[..., Recipe], volumes: Path) -> None:
    assert recipe(data=volumes, minutes=2, **SMALL).steps is None
    assert recipe(data=volumes, steps=5, **SMALL).steps == 5
    with pytest.raises(UserError, match="steps=0"):
        recipe(data=volumes, steps=0, **SMALL)
    unasked = recipe(data=volumes, **SMALL)
    assert unasked.minutes is None and unasked.steps in (4000, 300_000)


@both
def test_silhouettes_are_cut_if_asked(recipe: Callable[..., Recipe], volumes: Path) -> None:
    soft, cut = (recipe(data=volumes, binary=binary, **SMALL).looks[0][1].items for binary in (False, True))
    assert set(cut.unique().tolist()) == {0.0, 1.0} and len(soft.unique()) > 10


def test_chairs_unless_data_are_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "EMBEDDED_CHAIRS", 3)
    assert len(shapes(**SMALL).looks[0][1]) == 3 * 8
    assert len(shapes(views="direct", **SMALL).looks[0][1]) == 3


# Known views of pictures


def test_pictures_go_to_the_bin_of_their_view(known_masks: Path) -> None:
    made = shapes(data=known_masks, views="known", size=16)
    found = {o.name: {Path(name).stem for name in c.names} for o, c in made.looks}
    assert found == {"azimuth-00": {"front", "wrapped", "edge"}, "azimuth-01": {"past"}, "azimuth-04": {"side"}}


@pytest.mark.parametrize("bins", [1, 4, 16, 24])
def test_no_picture_is_lost_or_doubled(bins: int, volumes: Path) -> None:
    made = shapes(data=volumes, views="known", bins=bins, **SMALL)
    names = [name for _, collection in made.looks for name in collection.names]
    assert len(names) == len(set(names)) == 6 * 8


def test_pictures_of_unknown_views(masks: Path) -> None:
    assert len(shapes(data=masks, views="single", size=16).looks[0][1]) == 5
    with pytest.raises(UserError, match=r"known views are asked for but none are there; add a views.csv"):
        shapes(data=masks, views="known", size=16)


def test_views_that_fall_into_no_bin() -> None:
    latents = {"azimuth": torch.zeros(2), "elevation": torch.full((2,), 0.7)}
    high = Collection(torch.ones(2, 1, 16, 16), latents=latents)
    with pytest.raises(UserError, match="known view of 2 of 2 images lies outside every bin"):
        by_known_view(high, azimuth_bins(4))


def test_direct_training_needs_volumes(masks: Path) -> None:
    with pytest.raises(UserError, match="direct training needs volumes"):
        shapes(data=masks, views="direct", size=16)


def test_line_integrals_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "scans.npz", lines=np.ones((3, 32), np.float32))
    with pytest.raises(UserError, match="holds line integrals"):
        shapes(data=tmp_path / "scans.npz", steps=1)
