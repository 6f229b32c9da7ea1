"""Large collections: rounds predict what is drawn before the next one, and all other images look alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch
from comparing import differences, stats
from toy import BINS, jointly, only_panel, toy

from unproject._random import generator_at
from unproject.assignment import Known, PredictedState
from unproject.assignment import coverage as coverage_module
from unproject.assignment import predicting as predicting_module
from unproject.assignment.assigned import smallest
from unproject.assignment.coverage import Coverage, spread_over
from unproject.assignment.responsibilities import k_means
from unproject.data import Collection
from unproject.training import Recipe, resume, train
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer

IMAGES = 48
Begin = Callable[[Recipe], tuple[Trainer, PredictedState]]


@pytest.fixture(autouse=True)
def _large(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let 48 images count as many."""
    monkeypatch.setattr(predicting_module, "WHOLE", 40)
    monkeypatch.setattr(predicting_module, "MEASURED", 16)
    monkeypatch.setattr(coverage_module, "MIN_PREDICTED", 2)


@pytest.fixture
def predicted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The rows of each round, and how many the predictor has seen."""
    found: list[int] = []
    extend = Coverage.extend

    def remembering(self: Coverage, *arguments: object) -> torch.Tensor:
        rows = extend(self, *arguments)  # type: ignore[arg-type]
        found.append(len(rows))
        return rows

    monkeypatch.setattr(Coverage, "extend", remembering)
    return found


@pytest.fixture
def begun(tmp_path: Path) -> Iterator[Callable[[Recipe], tuple[Trainer, PredictedState]]]:
    """Return what begins a run."""
    with Recorder(tmp_path, quiet=True) as recorder:

        def begin(recipe: Recipe) -> tuple[Trainer, PredictedState]:
            trainer = Trainer(recipe, tmp_path, recorder)
            state = trainer.state.panels[0].assignment
            assert isinstance(state, PredictedState)
            return trainer, state

        yield begin


@pytest.mark.parametrize("joint", [False, True])
def test_every_image_that_is_drawn_was_predicted_in_its_round(joint: bool, begun: Begin, predicted: list[int]) -> None:
    recipe = toy(steps=12)
    trainer, state = begun(jointly(recipe) if joint else recipe)
    for step in range(12):
        trainer.step()
        if state.coverage is not None and step >= 3:
            first, end = state.coverage.places.tolist()
            assert first <= 4 * step and 4 * (step + 1) <= end
    assert predicted == [12, 12, 12], "three rounds of three steps of four images, not of 48"


def test_further_images_are_predicted_when_the_budget_has_grown(tmp_path: Path, predicted: list[int]) -> None:
    recipe = toy(steps=12)
    train(recipe, tmp_path / "run", quiet=True)
    resume(tmp_path / "run", recipe, steps=24, quiet=True)
    assert predicted == [12, 12, 12, 24, 24], "at step 12, where nothing was foreseen, and in the round at 18"
    assert [line["step"] for line in stats(tmp_path / "run") if "loss" in line and "round" in line] == [3, 6, 9, 18]


def test_a_run_of_many_images_resumes_as_if_it_had_not_stopped(tmp_path: Path) -> None:
    recipe = toy(steps=12)
    recipe = recipe.replace(checkpoint_every=5)
    for name in ("whole", "killed"):
        train(recipe, tmp_path / name, quiet=True)
    (tmp_path / "killed" / "checkpoints" / "step-000000012.safetensors").unlink()
    resume(tmp_path / "killed", recipe, quiet=True)
    assert differences(tmp_path / "whole", tmp_path / "killed") == []


def test_scores_say_how_many_images_they_are_of(begun: Begin) -> None:
    trainer, state = begun(toy(steps=12))
    for _ in range(4):
        trainer.step()
    scores = state.checks()
    assert scores["view_information"].n == 16 and "16 images spread over 48" in scores["view_information"].protocol
    estimates = state.estimates()
    assert (estimates >= 0).sum() == 16 and estimates.shape == (IMAGES,) and estimates.max() < BINS


def test_images_that_are_not_predicted_are_as_frequent_as_those_that_are() -> None:
    values, rows = torch.tensor([3, 3, 3, 1]), torch.tensor([5, 90_000, 7, 8])
    whole = spread_over(values, rows, 100_000, generator_at(0))
    assert whole[rows].tolist() == [3, 3, 3, 1]
    assert (whole == 3).float().mean() == pytest.approx(0.75, abs=0.01) and set(whole.tolist()) == {1, 3}


def test_clusters_of_many_rows_are_found_by_some(monkeypatch: pytest.MonkeyPatch) -> None:
    rows = torch.eye(3)[torch.arange(90) % 3] + 0.01 * torch.rand(90, 3, generator=generator_at(0))
    whole = k_means(rows, 3, seed=0)
    monkeypatch.setattr("unproject.assignment.responsibilities.SAMPLE", 20)
    some = k_means(rows, 3, seed=0)
    for labels in (whole, some):
        assert all(len(labels[k::3].unique()) == 1 for k in range(3)) and len(labels.unique()) == 3


@pytest.mark.parametrize(("count", "kind"), [(1, torch.int8), (128, torch.int8), (129, torch.int16)])
def test_indices_are_as_small_as_they_can_be(count: int, kind: torch.dtype) -> None:
    assert smallest(count) == kind and torch.tensor(count - 1).to(kind).item() == count - 1


def test_a_state_stores_a_byte_an_image() -> None:
    panel = only_panel(toy(views="known"))
    state = Known().begin(panel, 0)
    assert state.views.nbytes + state.heads.nbytes == 2 * len(panel)
    wide = state.state_dict() | {"views": state.views.long(), "heads": state.heads.long()}  # as older versions wrote
    state.load_state_dict(wide)
    assert state.views.dtype == torch.int8


def test_held_out_images_do_not_grow_with_the_collection(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.recipes.shape_panels.MOST_HELD_OUT", 20)
    from unproject.projections.silhouette import Silhouette, azimuth_bins
    from unproject.recipes.pairing import frequent_rounds
    from unproject.recipes.shape_panels import split_panel

    views = azimuth_bins(4, Silhouette(size=16))
    images = Collection(torch.randint(0, 255, (800, 1, 16, 16), dtype=torch.uint8, generator=generator_at(0)))
    panel = split_panel("predicted", 1, views, images, frequent_rounds(2, 0.5), 0, False)
    assert panel.held_out is not None and len(panel.held_out) <= 40 and len(panel) + len(panel.held_out) == 800


def test_a_large_collection_needs_the_predictor_of_another_run(tmp_path: Path, begun: Begin) -> None:
    """Views taken over from another run are of some images; those drawn are predicted at once."""
    source = train(toy(steps=12), tmp_path / "source", quiet=True)
    trainer, state = begun(toy(steps=12, seed=1))
    from unproject.training.start import start_from

    start_from(trainer.state, source.path)
    assert state.coverage is not None and state.coverage.places.tolist() == [0, 0]
    trainer.step()
    assert state.coverage.places[1] >= 4
