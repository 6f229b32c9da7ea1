"""Evaluation: what of a run can be scored, against what, and up to which gauge."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from toy import BINS, CHAIRS, SIZE, only_panel, toy

from unproject._types import UserError
from unproject.assignment import AssignmentState, Estimator, JointlyPredicted, Panel, Predicted, PredictorFit
from unproject.data import Collection, chairs, observe
from unproject.domains import Images, Volumes
from unproject.metrics import Gauge
from unproject.networks import ViewPredictor
from unproject.projections import Silhouette, azimuth_bins
from unproject.recipes import find
from unproject.training import Run, load, train
from unproject.training.distribution import Distribution
from unproject.training.evaluation import supervised_ceiling, true_views
from unproject.training.fitted_pictures import Frame
from unproject.training.fitting import by_name, of_different_kinds

RECIPE = toy(steps=4)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return train(RECIPE, tmp_path_factory.mktemp("run") / "run", quiet=True)


def test_true_views_are_the_bins_of_the_known_latents() -> None:
    panel = only_panel(RECIPE)
    true, latents = true_views(panel), panel.collections[0].latents
    assert true is not None and latents is not None
    assert torch.equal(true, latents["view"].long())
    assert true_views(Panel(panel.observations, Collection(panel.collections[0].items))) is None


def test_assigned_views_are_those_of_the_newest_checkpoint(run: Run) -> None:
    (state,) = run.assignments()
    assert len(state.views) == 2 * CHAIRS and torch.equal(state.views, state.heads)


def test_views_are_scored_where_they_are_known(run: Run) -> None:
    scores = {name: score for name, score in run.evaluate(n=8).items() if name.startswith("view_")}
    assert {"view_exact", "view_within_one", "view_chance_exact", "view_information"} <= scores.keys()
    assert all(0 <= score.value <= 100 for score in scores.values())


def test_a_perfect_assignment_scores_perfectly(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to gauge: every bin turned by one, and mirrored, is as good."""
    true = true_views(only_panel(RECIPE))
    assert true is not None
    monkeypatch.setattr("unproject.assignment.predicted.PredictedState.estimates", lambda self: (1 - true) % BINS)
    assert run.evaluate(n=8)["view_exact"].value == pytest.approx(1.0)


def test_an_assignment_at_random_scores_about_chance(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    true = true_views(only_panel(RECIPE))
    assert true is not None
    shuffled = true[torch.randperm(len(true), generator=torch.Generator().manual_seed(0))]
    monkeypatch.setattr("unproject.assignment.predicted.PredictedState.estimates", lambda self: shuffled)
    scores = run.evaluate(n=8)
    assert abs(scores["view_exact"].value - scores["view_chance_exact"].value) < 0.2 < 1 - scores["view_exact"].value


def test_without_a_reference_a_run_is_checked_by_itself(tmp_path: Path) -> None:
    """Samples by themselves, their projections against the training images, and nothing of views that are known."""
    recipe = toy(steps=1, views="known")
    train(recipe, tmp_path, quiet=True)
    scores = load(tmp_path, recipe=recipe).evaluate(n=12)
    assert {"diversity", "in_one_piece", "empty", "mmd_iou_silhouette"} <= scores.keys()
    assert "training images" in scores["mmd_iou_silhouette"].protocol
    assert not [name for name in scores if name.startswith("view")]


def test_a_run_just_trained_knows_its_recipe(tmp_path: Path) -> None:
    """Though nothing on disk says how to make it again."""
    recipe = toy(steps=1, views="known").replace(seed=3)
    run = train(recipe, tmp_path, quiet=True)
    assert run.complete and "diversity" in run.evaluate(n=8)
    with pytest.raises(UserError, match="built in Python"):
        load(tmp_path).evaluate(n=8)


def test_self_checks_of_good_and_of_bad_samples() -> None:
    domain, shapes = Volumes(), torch.zeros(12, SIZE, SIZE, SIZE)
    for k, shape in enumerate(shapes):
        shape[k // 2 : 10, 2:12, 3 : 6 + k // 2] = 1
    broken = torch.zeros(4, SIZE, SIZE, SIZE)
    broken[:2, :4], broken[:2, 8:12] = 1, 1
    checks = domain.checks(torch.cat([shapes[:4], broken]))
    assert checks["empty"].value == 0.25 and checks["in_one_piece"].value == pytest.approx(4 / 6)
    same = domain.checks(shapes[:1].expand(6, -1, -1, -1))
    assert abs(same["diversity"].value) < 1e-6 and domain.checks(shapes)["diversity"].value > 0.1


def test_parts_that_float_are_removed_from_samples_if_asked(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    broken = torch.zeros(2, SIZE, SIZE, SIZE)
    broken[:, :6], broken[0, 9:12] = 1, 1
    monkeypatch.setattr(type(run.generator), "sample", lambda self, n, seed=0: broken[:n])
    assert torch.equal(run.sample(2), broken)
    whole = run.sample(2, largest_part=True)
    assert torch.equal(whole[1], broken[1]) and torch.equal(whole[0], broken[1])
    assert run.domain.checks(whole)["in_one_piece"].value == 1.0


def test_samples_without_parts_stay_as_they_are() -> None:
    dots = (torch.rand(2, 1, 16, 16, generator=torch.Generator().manual_seed(0)) > 0.9).float()
    assert torch.equal(Images().largest_part(dots), dots)


def test_shapes_score_perfectly_against_themselves(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    shapes = chairs(12, SIZE, seed=3)
    monkeypatch.setattr(type(run.generator), "sample", lambda self, n, seed=0: shapes)
    scores = run.evaluate(Collection(shapes), n=12)
    assert scores["mmd_iou"].value == pytest.approx(0.0, abs=1e-6) and scores["cov_iou"].value == 1.0
    assert scores["in_one_piece"] == run.domain.checks(shapes)["in_one_piece"]


def test_a_reference_that_fits_nothing_is_refused(run: Run) -> None:
    with pytest.raises(UserError, match=r"references are of shape \(5,\); give samples or projections"):
        run.evaluate(torch.zeros(8, 5), n=8)


def test_projections_are_scored_in_views_as_frequent_as_the_datas(run: Run) -> None:
    scores = run.evaluate(only_panel(RECIPE).collections[0], n=24)
    assert {"mmd_iou_silhouette", "in_one_piece"} <= scores.keys()
    (state,) = run.assignments()
    state.views.fill_(2)
    assert set(AssignmentState.draw_views(state, 50, torch.Generator()).tolist()) == {2}


def test_the_ceiling_learns_views_that_can_be_told_apart() -> None:
    stripes = torch.zeros(64, 1, SIZE, SIZE)
    true = torch.arange(64) % BINS
    for i, view in enumerate(true.tolist()):
        stripes[i, :, :, 4 * view : 4 * view + 4] = 1
    panel = Panel(only_panel(RECIPE).observations, Collection(stripes))
    assert supervised_ceiling(Volumes(), panel, true, 0, steps=30).exact > 0.9


def test_the_ceiling_is_that_of_the_panels_own_predictor() -> None:
    made: list[torch.nn.Module] = []

    def network(shape: tuple[int, ...], views: int) -> torch.nn.Module:
        made.append(ViewPredictor(shape, views, channels=4))
        return made[-1]

    panel = only_panel(RECIPE)
    panel = replace(panel, assignment=Predicted(fit=PredictorFit(network)))
    true = true_views(panel)
    assert true is not None
    supervised_ceiling(Volumes(), panel, true, 0, steps=1)
    assert len(made) == 2


def test_views_are_scored_by_the_most_probable_ones(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though samples are projected in views that are drawn, as those of large collections are."""
    panel = replace(only_panel(RECIPE), assignment=JointlyPredicted(estimator=Estimator("posterior", balance=0.5)))
    state = panel.assignment.begin(panel, 0)
    assert torch.equal(state.estimates(), state.views.long())  # nothing was predicted
    p = torch.full((len(panel), BINS), 0.4 / (BINS - 1))
    best = torch.arange(len(panel)) % BINS
    p[torch.arange(len(panel)), best] = 0.6
    monkeypatch.setattr(state, "_probabilities", lambda rows=None: p)
    state.round.fill_(1)
    state._take(*state.settings.estimator.assign(p, 0), None, 0)
    assert torch.equal(state.estimates(), best) and not torch.equal(state.views.long(), best)


@pytest.mark.parametrize("device", ["abacus", "cuda"])
def test_a_device_that_is_not_there(device: str) -> None:
    if device == "cuda" and torch.cuda.is_available():
        pytest.skip("it is there")
    with pytest.raises(UserError, match=f"device '{device}'"):
        Distribution(device)


def test_one_process_alone_needs_nobody() -> None:
    alone = Distribution("cpu")
    assert (alone.world, alone.rank, alone.leads) == (1, 0, True)
    assert alone.average(3.0) == 3.0 and alone.agree(True) and not alone.agree(False)
    alone.barrier()
    alone.close()


def test_a_single_picture_has_no_ceiling() -> None:
    panel = only_panel(RECIPE)
    with pytest.raises(UserError, match="two pictures at least"):
        supervised_ceiling(Volumes(), panel, torch.zeros(1, dtype=torch.long), 0)


def test_no_samples_are_none_and_fewer_are_refused(run: Run) -> None:
    assert len(run.sample(0)) == 0
    with pytest.raises(UserError, match="-1 samples: give 0 or more"):
        run.sample(-1)


def test_one_sample_is_not_compared_with_itself() -> None:
    assert "diversity" not in Volumes().checks(chairs(1, SIZE))
    assert "diversity" not in Images().checks(torch.rand(1, 1, 16, 16))
    one_of_two = chairs(2, SIZE)
    one_of_two[1] = 0
    assert Volumes().checks(one_of_two)["diversity"].value == 0


def test_panels_of_other_projections_are_of_other_kinds() -> None:
    """Names of views are the same at any size; pictures of known views beside others are no other kind."""

    def state(*views: int, size: int = 16) -> Any:
        observations = [azimuth_bins(4, Silhouette(size=size))[k] for k in views]
        return SimpleNamespace(panel=SimpleNamespace(observations=observations, projection=observations[0].projection))

    small, large, some, again = state(0, 1, 2, 3), state(0, 1, 2, 3, size=32), state(1, 2), state(0, 1, 2, 3)
    assert of_different_kinds([small, large]) == [small, large]
    assert of_different_kinds([some, small]) == of_different_kinds([small, some]) == [small]
    assert of_different_kinds([small, again, some]) == [small]
    assert by_name([small, again, large]) == {"azimuth-00": small, "azimuth-00-2": large}


def test_of_anchors_beside_lines_of_unknown_direction_the_lines_are_scored(tmp_path: Path) -> None:
    rng, anchors = np.random.default_rng(0), tmp_path / "anchors.npz"
    np.savez(anchors, lines=rng.random((9, 16)).astype(np.float32) / 2, angle=np.zeros(9))
    np.savez(tmp_path / "images.npz", images=rng.random((40, 1, 16, 16)).astype(np.float32))
    given = {"data": tmp_path / "images.npz", "size": 16, "bins": 2, "batch": 4, "channels": 8, "tries": 1}
    recipe = find("digits")(views="predicted", anchors=anchors, steps=1, **given)
    scores = train(recipe, tmp_path / "run", quiet=True).evaluate(n=32)
    assert scores["frechet_line"].protocol.count("32 training images") == 1
    assert not any("direction" in name for name in scores)


def test_fewer_than_one_sample_is_no_score(run: Run) -> None:
    for n in (0, -1):
        with pytest.raises(UserError, match=f"n={n} samples: give at least 1"):
            run.evaluate(n=n)


def test_an_odd_number_of_views_is_scored_without_views(tmp_path: Path) -> None:
    """A reflection does not map five bins to five bins."""
    views = azimuth_bins(5, Silhouette(size=SIZE))
    seen = observe(chairs(8, SIZE), views)
    recipe = toy(steps=1)
    panel = replace(recipe.panels[0], observations=views, data=seen)
    recipe = recipe.replace(panels=[panel])
    run = train(recipe, tmp_path, quiet=True)
    assert not {"view_exact", "view_within_one"} & run.evaluate(n=8).keys()
    scores = run.evaluate(chairs(8, SIZE), n=8)
    assert "mmd_iou" in scores and "of 20" in scores["mmd_iou"].protocol


def test_the_frame_of_a_run_is_told_by_known_views_of_training(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one whose views were all found, a quarter turn on; of one that found none; and of one that was given them."""
    (state,) = run.assignments()
    true = true_views(state.panel)
    assert true is not None
    monkeypatch.setattr(state, "estimates", lambda: (true + 1) % BINS)
    assert Frame.of(run.domain, [state], state) == Frame("azimuth", Gauge(1, False, BINS))
    monkeypatch.setattr(state, "estimates", lambda: torch.zeros_like(true))
    assert Frame.of(run.domain, [state], state) == Frame("azimuth")
    monkeypatch.setattr(state, "fixes_gauge", True)
    assert Frame.of(run.domain, [state], state) == Frame()
