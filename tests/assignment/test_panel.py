"""Panels: observations with one projection share a discriminator; weights, penalties and pairs are the panel's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.adversarial.losses import Relativistic
from unproject.adversarial.penalties import R1R2
from unproject.assignment import (
    Assignment,
    AssignmentState,
    Estimator,
    Known,
    LearnedPrior,
    Panel,
    Predicted,
    PredictorFit,
    Rounds,
    Unassigned,
    by_view,
    views_of,
)
from unproject.data import Collection, chairs, observe
from unproject.networks import Discriminator, LowRankGenerator, ViewPredictor
from unproject.projections.base import Projection
from unproject.projections.observation import Observation
from unproject.projections.priors import Mixture, Product, Uniform
from unproject.projections.silhouette import Silhouette, azimuth_bins
from unproject.training import Adam, Recipe, checkpoint, resume, train
from unproject.training.trainer import Trainer

SIZE, BINS, CHAIRS = 16, 4, 24
SILHOUETTE = Silhouette(size=SIZE, rule="absorption", density=2.0)
VIEWS = azimuth_bins(BINS, SILHOUETTE)


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def silhouettes() -> Collection:
    return observe(Collection(chairs(CHAIRS, SIZE)), VIEWS, 2, 0)


@dataclass(frozen=True)
class Plan(Projection):
    """Seen from above, `scale` times as bright."""

    scale: float = 1.0

    def forward(self, x: Tensor) -> Tensor:
        return self.scale * x.amax(2)[:, None]


def plan(scale: float = 1.0, count: int = 6, **settings: Any) -> Panel:
    """A panel of plans of chairs."""
    projection = Plan(scale)
    return Panel([Observation(f"plan {scale}", projection)], Collection(projection(chairs(count, SIZE))), **settings)


def recipe(*panels: Panel, **changes: Any) -> Recipe:
    """A small recipe with these panels."""
    settings: dict[str, Any] = {
        "discriminator": partial(Discriminator, channels=4),
        "loss": Relativistic(),
        "penalty": R1R2(1.0, every=4),
        "generator_optimiser": Adam(5e-4),
        "discriminator_optimiser": Adam(5e-4),
        "batch": 4,
        "steps": 1,
        **changes,
    }
    return Recipe(partial(LowRankGenerator, size=SIZE, channels=8, rank=4, code_size=8), panels, **settings)


def final(run: Path) -> dict[str, Tensor]:
    return checkpoint.load(checkpoint.newest(run / "checkpoints"))


# What a panel is


def test_a_panel_has_one_projection_object() -> None:
    shared, other = Plan(), Plan(0.5)
    images = Collection(shared(chairs(4, SIZE)))
    assert Panel([Observation("a", shared), Observation("b", Plan())], [images, images]).shape == (1, SIZE, SIZE)
    with pytest.raises(UserError, match="panel of 'a', 'b': its observations must share one projection"):
        Panel([Observation("a", shared), Observation("b", other)], [images, images])


def test_collections_are_one_or_one_each_and_of_one_size() -> None:
    images = Collection(Plan()(chairs(4, SIZE)))
    small = Collection(images.items[:, :, ::2, ::2])
    three = [Observation(name, Plan()) for name in "abc"]
    assert len(Panel(three, images)) == 4 and len(Panel(three, [images] * 3)) == 12
    with pytest.raises(UserError, match="2 collections for 3 observations; give one for all, or one for each"):
        Panel(three, [images, images])
    with pytest.raises(UserError, match="its images differ in size"):
        Panel(three[:2], [images, small])
    with pytest.raises(UserError, match="at least one observation"):
        Panel([], images)


@pytest.mark.parametrize("name", ["weight", "penalty_scale"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.inf, math.nan])
def test_weights_and_scales_are_positive(name: str, value: float) -> None:
    with pytest.raises(UserError, match=f"{name}=.*: must be positive"):
        plan(**{name: value})


def test_rows_run_through_the_collections(silhouettes: Collection) -> None:
    seen, parts = by_view(silhouettes, VIEWS)
    panel = Panel(seen, parts)
    assert tuple(seen) == VIEWS and len(by_view(silhouettes.subset([0]), VIEWS)[0]) == 1
    assert len(panel) == len(silhouettes) == sum(map(len, parts))
    whole = torch.cat([part.items for part in parts])
    rows = torch.randperm(len(panel), generator=generator_at(0))
    assert torch.equal(panel.batch(rows), whole[rows])


# Assignments at the start


def test_known_views_are_those_of_the_collections_or_of_the_latents(silhouettes: Collection) -> None:
    assert silhouettes.latents is not None
    true = silhouettes.latents["view"].long()
    shared = Known().begin(Panel(VIEWS, silhouettes), 0)
    assert torch.equal(shared.views, true) and torch.equal(shared.heads, true) and shared.fixes_gauge
    apart = Known().begin(Panel(*by_view(silhouettes, VIEWS)), 0)
    assert torch.equal(apart.views, true.sort().values) and torch.equal(apart.heads, apart.views)
    alone = Known().begin(plan(), 0)
    assert alone.views.tolist() == [0] * 6 and not alone.fixes_gauge


def test_known_views_must_be_known_and_lie_in_a_bin(silhouettes: Collection) -> None:
    unknown = Collection(silhouettes.items)
    with pytest.raises(UserError, match="known views are asked for but none are there"):
        Known().begin(Panel(VIEWS, unknown), 0)
    with pytest.raises(UserError, match="lies outside every bin"):
        views_of(silhouettes, VIEWS[:2])


def test_unknown_views_start_at_random_and_with_one_head(silhouettes: Collection) -> None:
    panel = Panel(VIEWS, silhouettes, Predicted(fit=PredictorFit(partial(ViewPredictor, channels=4))))
    state = panel.assignment.begin(panel, 0)
    assert state.views.unique().tolist() == list(range(BINS)) and state.heads.unique().tolist() == [0]
    assert len(state.views) == len(silhouettes) and panel.assignment.heads(panel) == BINS
    assert Predicted(estimator=Estimator(clusters=3)).heads(panel) == 3


@pytest.mark.parametrize("assignment", [Predicted(), LearnedPrior(), Unassigned()], ids=lambda a: type(a).__name__)
def test_unknown_views_need_one_collection_and_several_observations(
    silhouettes: Collection, assignment: Assignment
) -> None:
    for panel in (Panel(VIEWS[:1], silhouettes), Panel(VIEWS[:2], [silhouettes, silhouettes])):
        with pytest.raises(UserError, match="at least two observations and one collection"):
            assignment.begin(panel, 0)


def test_each_image_is_paired_with_its_own_view() -> None:
    """With bins of no width, a panel's projections are those at each observation's angle."""
    angles = [0.3, 1.2, 2.9]
    level = Uniform("elevation", 0, 0)
    projection = Silhouette(size=SIZE)
    observations = [Observation(f"{a}", projection, Product(Uniform("azimuth", a, a), level)) for a in angles]
    panel = Panel(observations, Collection(torch.zeros(4, 1, SIZE, SIZE)))
    shapes, views = chairs(4, SIZE), torch.tensor([2, 0, 1, 0])
    expected = projection(shapes, azimuth=torch.tensor(angles)[views], elevation=torch.zeros(4))
    assert torch.allclose(panel.project(shapes, views, generator_at(0)), expected, atol=1e-6)


def test_unassigned_samples_are_projected_as_a_mixture_of_all_priors(silhouettes: Collection) -> None:
    panel = Panel(VIEWS, silhouettes, Unassigned())
    state, x = panel.assignment.begin(panel, 0), chairs(64, SIZE)
    mixed = Observation("any", SILHOUETTE, Mixture([view.prior for view in VIEWS]))
    alone = Panel([mixed], silhouettes)
    expected = alone.project(x, torch.zeros(64, dtype=torch.long), generator_at(3))
    assert torch.equal(state.project(x, torch.zeros(64, dtype=torch.long), generator_at(3)), expected)
    counts = torch.bincount(state.draw_views(16_000, generator_at(4)), minlength=BINS)
    assert ((counts - 4000) ** 2 / 4000).sum() < 16.3  # χ², 3 degrees of freedom, once in a thousand


def test_assigned_views_stay_where_rows_are_drawn(silhouettes: Collection) -> None:
    """`.to` moves parameters; labels are not converted either."""
    panel = Panel(VIEWS, silhouettes, LearnedPrior())
    state = panel.assignment.begin(panel, 0).to(torch.float64)
    assert state.views.dtype == torch.int8 and next(state.parameters()).dtype == torch.float64
    meta = panel.assignment.begin(panel, 0).to("meta")
    assert meta.views.device.type == "cpu" and next(meta.parameters()).device.type == "meta"


# Weights in training


def first_loss(monkeypatch: pytest.MonkeyPatch, method: str, run: Recipe, path: Path) -> Any:
    """What an update returns in the first step, before which nothing differs."""
    found, update = [], getattr(Trainer, method)
    monkeypatch.setattr(Trainer, method, lambda self, *a: (found.append(update(self, *a)), found[-1])[1])
    train(run, path, quiet=True)
    monkeypatch.setattr(Trainer, method, update)
    return found[0]


def test_a_panel_counts_as_its_weight_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """loss_g = Σ_i w_i loss_i."""

    def loss(*weights: float) -> float:
        panels = [plan(scale, weight=weight) for scale, weight in zip((1.0, 0.5), weights, strict=True)]
        return first_loss(monkeypatch, "_update_generator", recipe(*panels), tmp_path / str(weights)).item()

    even, first, second = loss(1, 1), loss(3, 1), loss(1, 3)
    assert first + second == pytest.approx(4 * even, rel=1e-4) and abs(first - second) > 1e-4


def test_a_discriminator_is_penalised_as_its_panel_says(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The penalty is Σ_i s_i penalty_i."""

    def penalty(*scales: float) -> float:
        panels = [plan(scale, penalty_scale=s) for scale, s in zip((1.0, 0.5), scales, strict=True)]
        run = recipe(*panels, penalty=R1R2(1.0, every=1))
        return first_loss(monkeypatch, "_update_discriminators", run, tmp_path / str(scales))["penalty"].item()

    even, first, second = penalty(1, 1), penalty(3, 1), penalty(1, 3)
    assert first + second == pytest.approx(4 * even, rel=1e-4) and abs(first - second) > 1e-6 * even


def test_balanced_panels_contribute_alike(tmp_path: Path) -> None:
    """A first update with balance is one with weights divided by the gradient norms that it measured."""
    first, second = plan(1.0), plan(0.5, weight=2.0)
    balanced = final(train(recipe(first, second, balance_every=1), tmp_path / "balanced", quiet=True).path)
    norms = [balanced[f"panels/{k}/gradient_norm"].item() for k in range(2)]
    assert norms[0] != norms[1] and min(norms) > 0
    divided = recipe(plan(1.0, weight=1 / norms[0]), plan(0.5, weight=2 / norms[1]))
    plain = final(train(divided, tmp_path / "plain", quiet=True).path)
    assert plain["panels/0/gradient_norm"] == 0
    moments = [name for name in plain if name.startswith("generator_optimiser") and name.endswith("exp_avg")]
    for name in moments:
        assert torch.allclose(plain[name], balanced[name], rtol=1e-4, atol=1e-7)
    alone = final(train(recipe(first, plan(0.5, weight=1e-9)), tmp_path / "alone", quiet=True).path)
    # The first moment is 1 - β₁ = 1 of the gradient.
    norm = torch.cat([alone[name].flatten() for name in moments]).norm().item()
    assert norm == pytest.approx(norms[0], rel=1e-4)


def test_one_panel_alone_has_nothing_to_balance(tmp_path: Path) -> None:
    run = train(recipe(plan(), balance_every=1, steps=2), tmp_path / "run", quiet=True)
    assert final(run.path)["panels/0/gradient_norm"] == 0
    with pytest.raises(UserError, match="balance_every=-1: give steps between two measurements, or 0"):
        recipe(plan(), balance_every=-1)


# Panels of several kinds


@pytest.mark.parametrize("balance_every", [0, 2])
def test_unknown_views_train_beside_known_maps(tmp_path: Path, silhouettes: Collection, balance_every: int) -> None:
    """Silhouettes of unknown view and plans in one run: the views are assigned in rounds."""
    fit = PredictorFit(partial(ViewPredictor, channels=4), images=32, steps=3, batch=8)
    unknown = Panel(VIEWS, silhouettes, Predicted(Rounds((0.3, 0.7)), fit))
    made = recipe(plan(), unknown, balance_every=balance_every, checkpoint_every=2)
    whole = train(made.replace(steps=6), tmp_path / "whole", quiet=True)
    train(made.replace(steps=3), tmp_path / "half", quiet=True)
    tensors = final(whole.path)
    rounds = [line["round"] for line in whole.stats() if line.get("event") == "assigned"]
    assert rounds == [1, 2] and all(line["panel"] == 1 for line in whole.stats() if "event" in line)
    assert not torch.equal(tensors["panels/1/assignment/views"], tensors["panels/1/assignment/heads"] * 0)
    assert tensors["panels/0/assignment/views"].unique().tolist() == [0]
    scores = whole.evaluate(n=8)
    assert {"diversity", "view_exact", "view_information_azimuth-00"} <= scores.keys()


def test_panels_of_several_kinds_resume(tmp_path: Path) -> None:
    made = recipe(plan(), plan(0.5), balance_every=2, checkpoint_every=2)
    whole = final(train(made.replace(steps=4), tmp_path / "whole", quiet=True).path)
    train(made.replace(steps=2), tmp_path / "half", quiet=True)
    half = final(resume(tmp_path / "half", made.replace(steps=4), quiet=True).path)
    assert all(torch.equal(whole[name], half[name]) for name in whole if name != "counters/seconds")


@dataclass(frozen=True)
class Halves(Assignment):
    """An assignment of a user's own: of every image it is known in which half of the views it was taken."""

    def begin(self, panel: Panel, seed: int) -> AssignmentState:
        return HalvesState(panel, views_of(panel.collections[0], panel.observations))


class HalvesState(AssignmentState):
    def __init__(self, panel: Panel, views: Tensor) -> None:
        half = len(panel.observations) // 2
        super().__init__(panel, views // half * half, views // half)

    def project(self, x: Tensor, rows: Tensor, rng: torch.Generator) -> Tensor:
        half = len(self.panel.observations) // 2
        return self.observe(x, self.views[rows] + torch.randint(half, (len(rows),), generator=rng), rng)

    def log(self) -> dict[str, Any]:
        return {"halves": self.heads.bincount().tolist()}


def test_an_assignment_of_a_users_own_trains(tmp_path: Path, silhouettes: Collection) -> None:
    run = train(recipe(Panel(VIEWS, silhouettes, Halves()), steps=20), tmp_path, quiet=True)
    assert sum(run.stats()[-1]["halves"]) == len(silhouettes)
    stored = final(run.path)
    assert stored["panels/0/assignment/heads"].unique().tolist() == [0, 1]
