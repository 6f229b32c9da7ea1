"""Evaluation: what of a run can be scored, against what, and up to which gauge."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from toy import BINS, CHAIRS, SIZE, toy

from unproject._types import UserError
from unproject.data import Collection, chairs
from unproject.training import Run, load, train
from unproject.training.distribution import Distribution
from unproject.training.evaluation import assigned_panel, evaluate, supervised_ceiling, true_views


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    return train(toy(steps=4), tmp_path_factory.mktemp("run") / "run", quiet=True)


def test_true_views_are_the_bins_of_the_known_latents() -> None:
    recipe = toy(steps=1)
    from unproject.training.panel import build_panels

    (panel,) = build_panels(recipe)
    true = true_views(recipe, panel)
    latents = recipe.looks[0][1].latents
    assert true is not None and latents is not None
    assert torch.equal(true, latents["view"].long())


def test_assigned_ways_are_those_of_the_newest_checkpoint(run: Run) -> None:
    panel = assigned_panel(run, toy(steps=4))
    assert len(panel.ways) == 2 * CHAIRS and torch.equal(panel.ways, panel.heads)


def test_views_are_scored_where_they_are_known(run: Run) -> None:
    scores = evaluate(run, toy(steps=4), None, n=8)
    assert scores and all("view" in name for name in scores)
    assert all(0 <= score.value <= 100 for score in scores.values())


def test_a_perfect_assignment_scores_perfectly(run: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to gauge: every bin turned by one, and mirrored, is as good."""
    import unproject.training.evaluation as evaluation

    def perfect(run: Run, recipe: object) -> object:
        panel = assigned_panel(run, toy(steps=4))
        true = true_views(toy(steps=4), panel)
        assert true is not None
        panel.ways = (1 - true) % BINS
        return panel

    monkeypatch.setattr(evaluation, "assigned_panel", perfect)
    scores = evaluate(run, toy(steps=4), None, n=8)
    assert max(score.value for score in scores.values()) == pytest.approx(1.0)


def test_nothing_to_score_against(tmp_path: Path) -> None:
    recipe = toy(steps=1, views="known")
    train(recipe, tmp_path, quiet=True)
    with pytest.raises(UserError, match="give --reference"):
        evaluate(load(tmp_path), recipe, None)


def test_shapes_score_perfectly_against_themselves(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    shapes = chairs(12, SIZE, seed=3)
    monkeypatch.setattr(type(run.generator), "sample", lambda self, n, seed=0: shapes)
    scores = evaluate(run, toy(steps=4), Collection(shapes), n=12)
    assert scores["mmd_iou"].value == pytest.approx(0.0, abs=1e-6) and scores["cov_iou"].value == 1.0


def test_the_ceiling_learns_views_that_can_be_told_apart() -> None:
    from unproject.training.panel import build_panels

    (panel,) = build_panels(toy(steps=1))
    stripes = torch.zeros(64, 1, SIZE, SIZE)
    true = torch.arange(64) % BINS
    for i, way in enumerate(true.tolist()):
        stripes[i, :, :, 4 * way : 4 * way + 4] = 1
    panel.items = stripes
    assert supervised_ceiling(panel, true, 0, steps=30).exact > 0.9


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
