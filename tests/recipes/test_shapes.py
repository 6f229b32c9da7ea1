"""The recipes of shapes: the data, the assignment and the discriminator of each row of their table."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from unproject._types import UserError
from unproject.adversarial.axisymmetric import Axisymmetric
from unproject.adversarial.inflated import Inflated
from unproject.adversarial.losses import Hinge, Relativistic, Wasserstein
from unproject.adversarial.penalties import R1R2, GradientPenalty
from unproject.adversarial.regularisers import Centred, Connected, Rectilinear, Regularisers, Solid, Varied
from unproject.assignment import (
    Known,
    LearnedPrior,
    MeanShapeInitialiser,
    Panel,
    Predicted,
    Rounds,
    Unassigned,
    by_view,
)
from unproject.data import Collection
from unproject.networks import LowRankGenerator, VoxelGenerator
from unproject.ops import aspect
from unproject.projections.base import Identity
from unproject.projections.silhouette import Silhouette, azimuth_bins
from unproject.recipes import shape_panels
from unproject.recipes.shapes import shapes as shapes_of
from unproject.recipes.shapes import shapes_paper
from unproject.training import Recipe, resume, train
from unproject.training.state import State


def shapes(**arguments: Any) -> Recipe:
    """The recipe without what is added for collections of few pictures and for views of one's own."""
    return shapes_of(**{"augment": False, "connected": 0.0, **arguments})


RECIPES: dict[str, Callable[..., Recipe]] = {"shapes": shapes, "shapes-paper": shapes_paper}
SMALL = {"size": 16, "views_per_shape": 8}


def only_panel(recipe: Recipe) -> Panel:
    (panel,) = recipe.panels
    return panel


def predicted_of(recipe: Recipe) -> Predicted:
    assignment = only_panel(recipe).assignment
    assert isinstance(assignment, Predicted)
    return assignment


both = pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)


# The table


@both
def test_predicted_views(recipe: Callable[..., Recipe], volumes: Path) -> None:
    panel = only_panel(recipe(data=volumes, views="predicted", **SMALL))
    assert isinstance(panel.assignment, Predicted)
    assert [o.name for o in panel.observations] == [f"azimuth-{k:02d}" for k in range(16)]
    (collection,) = panel.collections
    assert collection.items.shape == (6 * 8, 1, 16, 16)


@both
def test_known_views(recipe: Callable[..., Recipe], volumes: Path) -> None:
    panel = only_panel(recipe(data=volumes, views="known", **SMALL))
    assert isinstance(panel.assignment, Known) and len(panel) == 6 * 8
    for observation, collection in zip(panel.observations, panel.collections, strict=True):
        assert collection.latents is not None
        assert observation.prior.contains(collection.latents).all()
        assert {f"azimuth-{int(k):02d}" for k in collection.latents["view"]} <= {observation.name}


@both
@pytest.mark.parametrize("views, assignment", [("single", Unassigned), ("learned", LearnedPrior)])
def test_one_head_of_all_views(recipe: Callable[..., Recipe], views: Any, assignment: type, volumes: Path) -> None:
    panel = only_panel(recipe(data=volumes, views=views, **SMALL))
    azimuths = {"azimuth": torch.linspace(-10, 10, 50), "elevation": torch.zeros(50)}
    covered = torch.stack([observation.prior.contains(azimuths) for observation in panel.observations])
    assert isinstance(panel.assignment, assignment) and panel.assignment.heads(panel) == 1 and covered.any(0).all()
    (collection,) = panel.collections
    assert collection.items.shape == (6 * 8, 1, 16, 16)


@both
def test_direct_training(recipe: Callable[..., Recipe], volumes: Path) -> None:
    made = recipe(data=volumes, views="direct", **SMALL)
    panel = only_panel(made)
    assert isinstance(panel.assignment, Known) and isinstance(panel.projection, Identity)
    assert panel.shape == (16, 16, 16) and len(panel) == 6
    assert made.discriminator.keywords["volumetric"]  # type: ignore[attr-defined]


@pytest.mark.parametrize("views, solid", [("predicted", True), ("known", True), ("single", True), ("direct", False)])
def test_only_what_is_seen_in_silhouette_needs_to_be_told_to_be_solid(views: Any, solid: bool, volumes: Path) -> None:
    none = {"rectilinear": 0.0, "varied": 0.0, "inflated": 0.0, **SMALL}
    made = shapes(data=volumes, views=views, solid=0.3, **none)
    assert made.regulariser == (Solid(0.3, 0.03) if solid else None)
    assert shapes(data=volumes, views=views, solid=0.0, **none).regulariser is None


@pytest.mark.parametrize("views, unknown", [("predicted", True), ("single", True), ("known", False), ("direct", False)])
def test_plans_are_preferred_rectangular_varied_and_thick_where_views_do_not_tell_them(
    views: Any, unknown: bool, volumes: Path
) -> None:
    some = {"data": volumes, "views": views, "solid": 0.0, "rectilinear": 0.0, "varied": 0.0, "inflated": 0.0, **SMALL}
    assert shapes(**{**some, "rectilinear": 1.0}).regulariser == (Rectilinear(1.0, 0.3) if unknown else None)
    assert shapes(**{**some, "varied": 0.1}).regulariser == (Varied(0.1) if unknown else None)
    made = shapes(**{**some, "inflated": 10.0})
    assert made.regulariser == (Inflated(10.0, narrowest_of(made)) if unknown else None)
    assert shapes(**{**some, "inflated": 10.0, "mirror": False}).regulariser is None  # x = 0 is any plane


def narrowest_of(recipe: Recipe) -> float:
    """Of its training pictures, all of which were looked at."""
    panel = only_panel(recipe)
    return aspect(panel.batch(torch.arange(len(panel))), 0.02)


def test_shapes_need_not_be_thicker_than_the_narrowest_pictures_are_wide(tmp_path: Path) -> None:
    """Of cut-outs, and of pictures as they are; a few slivers do not count."""
    sides = [(40, 20)] * 90 + [(8, 20)] * 9 + [(1, 20)]
    pictures = np.zeros((100, 1, 64, 64), np.float32)
    for i, (wide, high) in enumerate(sides):
        pictures[i, 0, i % 40 : i % 40 + high, 10 : 10 + wide] = 1
        Image.fromarray(pictures[i, 0].astype(bool)).save(tmp_path / f"{i:03d}.png")
    np.savez(tmp_path / "pictures.npz", silhouettes=pictures)
    for data, size in ((tmp_path, 32), (tmp_path / "pictures.npz", 64)):
        made = shapes(data=data, size=size)
        thick = next(term for term in made.regulariser.terms if isinstance(term, Inflated))  # type: ignore[union-attr]
        assert thick.narrowest == pytest.approx(0.4, rel=0.05)


@pytest.fixture(scope="module")
def cups(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of silhouettes of cylinders, from 20 degrees above: cut-outs, each cropped to its object."""
    folder = tmp_path_factory.mktemp("cups")
    x, y, z = torch.meshgrid(*[torch.arange(32) - 15.5] * 3, indexing="ij")
    cups = torch.stack([(x.square() + z.square() < r * r) & (y.abs() < 10) for r in torch.linspace(6, 11, 12)])
    azimuth, elevation = torch.arange(12) * 0.5, torch.full((12,), 0.35)
    for i, picture in enumerate(Silhouette(size=64)(cups.float(), azimuth=azimuth, elevation=elevation)):
        rows, columns = (picture[0] > 0.5).any(1).nonzero()[:, 0], (picture[0] > 0.5).any(0).nonzero()[:, 0]
        cut = picture[0, rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1] > 0.5
        Image.fromarray(cut.byte().mul(255).numpy()).save(folder / f"{i:02d}.png")
    return folder


def test_round_shapes_are_preferred_where_pictures_show_round_feet(cups: Path) -> None:
    some = {"data": cups, "solid": 0.0, **SMALL}
    made = shapes(**some)
    assert isinstance(made.regulariser, Regularisers)
    assert [type(term) for term in made.regulariser.terms] == [Axisymmetric, Centred]
    assert Axisymmetric(2.0) in shapes(axisymmetric=2.0, **some).regulariser.terms  # type: ignore[union-attr]
    refused = shapes(axisymmetric=0.0, **some).regulariser
    assert [type(term) for term in refused.terms] == [Rectilinear, Varied, Inflated, Centred]  # type: ignore[union-attr]


def test_a_run_of_before_round_shapes_were_preferred_goes_on_without(cups: Path, tmp_path: Path) -> None:
    train(
        shapes(data=cups, size=16, axisymmetric=0.0, steps=2, batch=4, channels=8, rank=4), tmp_path / "run", quiet=True
    )
    file = tmp_path / "run" / "recipe.json"
    stored = json.loads(file.read_text())
    del stored["arguments"]["axisymmetric"]
    file.write_text(json.dumps(stored))
    assert resume(tmp_path / "run", steps=3, quiet=True).step == 3


def test_round_shapes_are_preferred_if_asked_and_views_are_unknown(volumes: Path) -> None:
    some = {"data": volumes, "solid": 0.0, "axisymmetric": 2.0, **SMALL}
    assert shapes(**some).regulariser == Axisymmetric(2.0)
    assert shapes(views="known", **some).regulariser is None


@pytest.mark.parametrize("views", ["predicted", "known", "direct"])
@pytest.mark.parametrize("name", ["solid", "rectilinear", "varied", "connected", "inflated", "axisymmetric"])
def test_weights_below_zero_are_refused_whether_used_or_not(volumes: Path, name: str, views: str) -> None:
    with pytest.raises(UserError, match="weight=-1"):
        shapes(data=volumes, views=views, **{name: -1.0}, **SMALL)


def test_shapes_in_one_piece_are_preferred_if_asked(volumes: Path) -> None:
    both = Regularisers((Solid(0.1, 0.01), Connected(0.5)))
    none = {"rectilinear": 0.0, "varied": 0.0, "inflated": 0.0, **SMALL}
    assert shapes(data=volumes, connected=0.5, **none).regulariser == both
    assert shapes(data=volumes, connected=0.5, solid=0.0, **none).regulariser == Connected(0.5)
    assert shapes(data=volumes, connected=0.5, views="direct", **SMALL).regulariser == Connected(0.5)


@pytest.mark.parametrize(
    "views, anywhere, heads",
    [("predicted", 0.25, 17), ("predicted", 0.0, 16), ("single", 0.25, 1), ("direct", 0.25, 1)],
)
def test_one_head_an_observation_and_one_for_samples_from_anywhere(
    views: Any, anywhere: float, heads: int, volumes: Path
) -> None:
    state = State(shapes(data=volumes, views=views, anywhere=anywhere, **SMALL), torch.device("cpu"))
    (panel,) = state.panels
    assert len(panel.discriminator.last.weight) == heads  # type: ignore[union-attr,arg-type]
    rows = torch.arange(3)
    assert panel.discriminator(panel.panel.batch(rows), panel.assignment.heads[rows].long()).shape == (3,)


def test_all_arms_see_the_same_silhouettes(volumes: Path) -> None:
    seen = [shapes(data=volumes, views=views, **SMALL) for views in ("predicted", "known", "single")]
    sums = [torch.cat([c.items for c in only_panel(made).collections]).sum() for made in seen]
    torch.testing.assert_close(sums, [sums[0]] * 3)


@both
def test_bands_of_elevation(recipe: Callable[..., Recipe], volumes: Path) -> None:
    made = recipe(data=volumes, views="known", bins=4, bands=3, **{**SMALL, "views_per_shape": 16})
    panel = only_panel(made)
    elevations = torch.cat([c.latents["elevation"] for c in panel.collections if c.latents is not None])
    assert len(panel.observations) == 12 and len(elevations) == 6 * 16
    assert elevations.abs().max().rad2deg() <= 22.5 and (elevations.abs().rad2deg() > 7.5).float().mean() > 0.4
    single = only_panel(recipe(data=volumes, views="single", bins=4, bands=3, **SMALL))
    asked = {"azimuth": torch.ones(3), "elevation": torch.tensor([-22.0, 0.0, 23.0]).deg2rad()}
    covered = torch.stack([observation.prior.contains(asked) for observation in single.observations]).any(0)
    assert covered.tolist() == [True, True, False]


@pytest.mark.parametrize("views", ["predicted", "known", "single", "direct"])
def test_flips_double_what_is_learned_from(views: Any, volumes: Path) -> None:
    plain, doubled = (shapes(data=volumes, views=views, flips=flips, **SMALL) for flips in (False, True))
    counts = [len(only_panel(made)) for made in (plain, doubled)]
    assert counts[1] == 2 * counts[0]


@pytest.mark.parametrize("wrong", [{"bins": 0}, {"bands": 0}, {"bands": 13}], ids=str)
def test_no_bins_are_refused(wrong: dict[str, int], volumes: Path) -> None:
    with pytest.raises(UserError, match=r"give at least one of each|bands=13: of 15° each, at most 12"):
        shapes(data=volumes, **SMALL, **wrong)


# Choices


def test_the_modern_choices(volumes: Path) -> None:
    made = shapes(data=volumes, rank=4, channels=16, mirror=True, gamma=3, rounds=2, **SMALL)
    generator = made.generator()
    assert isinstance(generator, LowRankGenerator) and generator.mirror
    assert generator.sample(1).shape == (1, 16, 16, 16)
    assert (made.loss, made.penalty) == (Relativistic(), R1R2(3, every=8))
    assert len(predicted_of(made).rounds.starts) == 2


@pytest.mark.parametrize("mirror", [True, False])
def test_the_initialiser_has_the_symmetry_of_what_is_made(mirror: bool, volumes: Path) -> None:
    made = predicted_of(shapes(data=volumes, init_views=True, mirror=mirror, balance=0.3, **SMALL))
    assert made.initialiser == MeanShapeInitialiser(mirror=mirror, balance=0.3) and made.estimator.balance == 0.3
    assert predicted_of(shapes(data=volumes, **SMALL)).initialiser is None


def test_the_seeds_choices(volumes: Path) -> None:
    made = shapes_paper(data=volumes, channels=16, **SMALL)
    generator = made.generator()
    assert isinstance(generator, VoxelGenerator) and generator.code_size == 256 and generator.truncation is None
    assert (made.loss, made.penalty, made.discriminator_steps) == (Wasserstein(), GradientPenalty(10), 2)
    assert (made.generator_optimiser.rate, made.generator_optimiser.beta1) == (1e-4, 0.5)
    assert made.discriminator.keywords["spectral"]  # type: ignore[attr-defined]
    predicted = predicted_of(made)
    assert predicted.fit.binarise and predicted.fit.fresh and predicted.fit.steps == 100_000
    assert predicted.rounds == Rounds((0.2, 0.4, 0.6, 0.8), restart=True) and predicted.estimator.draw == "argmax"
    assert only_panel(made).projection == Silhouette(size=16)


def test_the_released_choices(volumes: Path) -> None:
    made = shapes_paper(data=volumes, channels=16, released=True, loss="hinge", clusters=8, **SMALL)
    assert made.generator().truncation == 0.75
    assert only_panel(made).projection == Silhouette(size=16, rule="alpha", viewport=1.4)
    assert made.loss == Hinge() and made.penalty is None
    assert predicted_of(made).estimator.clusters == 8 and only_panel(made).assignment.heads(only_panel(made)) == 8


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
    soft, cut = (
        only_panel(recipe(data=volumes, binary=binary, **SMALL)).collections[0].items for binary in (False, True)
    )
    assert set(cut.unique().tolist()) == {0.0, 1.0} and len(soft.unique()) > 10


def test_chairs_unless_data_are_given(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shape_panels, "PROCEDURAL_CHAIRS", 3)
    assert len(only_panel(shapes(**SMALL))) == 3 * 8
    assert len(only_panel(shapes(views="direct", **SMALL))) == 3


# Known views of pictures


def test_pictures_go_to_the_bin_of_their_view(known_masks: Path) -> None:
    panel = only_panel(shapes(data=known_masks, views="known", size=16))
    pairs = zip(panel.observations, panel.collections, strict=True)
    found = {o.name: {Path(name).stem for name in c.names} for o, c in pairs if len(c)}
    assert found == {"azimuth-00": {"front", "wrapped", "edge"}, "azimuth-01": {"past"}, "azimuth-04": {"side"}}


@pytest.mark.parametrize("bins", [1, 4, 16, 24])
def test_no_picture_is_lost_or_doubled(bins: int, volumes: Path) -> None:
    panel = only_panel(shapes(data=volumes, views="known", bins=bins, **SMALL))
    names = [name for collection in panel.collections for name in collection.names]
    assert len(names) == len(set(names)) == 6 * 8


def test_pictures_of_unknown_views(masks: Path) -> None:
    assert len(only_panel(shapes(data=masks, views="single", size=16))) == 5
    with pytest.raises(UserError, match=r"known views are asked for but none are there; add a views.csv"):
        shapes(data=masks, views="known", size=16)


def test_views_that_fall_into_no_bin() -> None:
    latents = {"azimuth": torch.zeros(2), "elevation": torch.full((2,), 0.7)}
    high = Collection(torch.ones(2, 1, 16, 16), latents=latents)
    with pytest.raises(UserError, match="known view of 2 of 2 images lies outside every bin"):
        by_view(high, azimuth_bins(4))


def test_direct_training_needs_volumes(masks: Path) -> None:
    with pytest.raises(UserError, match="direct training needs volumes"):
        shapes(data=masks, views="direct", size=16)


def test_line_integrals_are_refused(tmp_path: Path) -> None:
    np.savez(tmp_path / "scans.npz", lines=np.ones((3, 32), np.float32))
    with pytest.raises(UserError, match="holds line integrals"):
        shapes(data=tmp_path / "scans.npz", steps=1)
