"""Samples seen from anywhere: which images they are paired with, which views they have, and which head judges them."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any
from unittest.mock import MagicMock

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from unproject._random import generator_at
from unproject._types import Diverged
from unproject.assignment import Estimator, JointlyPredicted, Panel, PredictedState, PredictorFit, Rounds
from unproject.data import Collection
from unproject.networks import ViewPredictor
from unproject.projections.silhouette import Silhouette, azimuth_bins

BINS, SIZE, IMAGES = 6, 16, 3000


def panel(anywhere: float | None, held_out: Collection | None = None, **estimator: Any) -> Panel:
    images = Collection(torch.rand(IMAGES, 1, SIZE, SIZE, generator=generator_at(0)))
    fit = PredictorFit(partial(ViewPredictor, channels=4))
    assignment = JointlyPredicted(Rounds((0.5,)), fit, Estimator("posterior", anywhere=anywhere, **estimator), weight=0)
    return Panel(azimuth_bins(BINS, Silhouette(size=SIZE)), images, assignment, held_out=held_out)


def assigned(anywhere: float | None, seed: int = 3, **estimator: Any) -> PredictedState:
    """The state after a round that found the first two of six views alone."""
    made = panel(anywhere, **estimator)
    state = made.assignment.begin(made, 0)
    assert isinstance(state, PredictedState)
    p = torch.zeros(IMAGES, BINS)
    p[::2, 0], p[1::2, 1] = 1, 1
    state._take(*state.settings.estimator.assign(p, seed), None, seed)
    return state


def seen(state: PredictedState, rows: Tensor, monkeypatch: pytest.MonkeyPatch) -> Tensor:
    """The views that samples paired with the images of these rows are projected in."""
    views: list[Tensor] = []
    monkeypatch.setattr(state, "observe", lambda x, found, rng: views.append(found))
    state.project(torch.zeros(len(rows), SIZE, SIZE, SIZE), rows, generator_at(0))
    return views[0]


def test_a_share_of_the_samples_is_seen_from_anywhere(monkeypatch: pytest.MonkeyPatch) -> None:
    state, plain = assigned(0.25), assigned(None)
    views = seen(state, torch.arange(IMAGES), monkeypatch)
    last = state.heads == BINS
    assert last.float().mean().item() == pytest.approx(0.25, abs=0.03)  # four deviations
    shares = torch.bincount(views[last], minlength=BINS) / last.sum()
    assert (shares - 1 / BINS).abs().max() < 0.06
    assert torch.equal(views[~last], state.views[~last].long()) and views[~last].max() == 1
    assert torch.equal(state.heads[~last], state.views[~last])
    assert torch.equal(state.views, plain.views)  # what is predicted of the images stays


def test_all_processes_give_up_what_one_cannot_predict(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first one decides, since each would wait for the others."""
    state, given = assigned(None), torch.full((IMAGES, BINS), 1 / BINS)
    monkeypatch.setattr(state, "_probabilities", lambda: given)
    for of_first in (True, False):

        def synchronise(tensors: Iterable[Tensor], of_first: bool = of_first) -> None:
            for tensor in tensors:
                if not tensor.ndim and tensor.is_floating_point():
                    tensor.fill_(of_first)

        run = MagicMock(synchronise=synchronise, step=7)
        if of_first:
            assert state._predicted(run, None) is given
        else:
            with pytest.raises(Diverged, match="by step 7: predicted views are not finite"):
                state._predicted(run, None)


def test_others_are_chosen_in_another_round() -> None:
    one, same, another = (assigned(0.25, seed) for seed in (3, 3, 4))
    assert torch.equal(one.heads == BINS, same.heads == BINS) and torch.equal(one.sampled, same.sampled)
    both = ((one.heads == BINS) & (another.heads == BINS)).float().mean().item()
    assert both == pytest.approx(0.25**2, abs=0.02)


def test_clusters_keep_their_heads() -> None:
    state = assigned(0.5, clusters=2)
    assert state.panel.assignment.heads(state.panel) == 3
    assert state.heads.unique().tolist() == [0, 1, 2] and (state.heads == 2).float().mean() > 0.4


def test_a_round_that_finds_the_same_clusters_leaves_the_heads() -> None:
    state = assigned(None, clusters=3)
    p, run = torch.full((IMAGES, BINS), 0.02), MagicMock()
    p[torch.arange(IMAGES), torch.randint(3, (IMAGES,), generator=generator_at(5))] = 0.9
    assert hasattr(state, "_assign")
    heads = []
    for seed in range(4):
        state._assign(run, p, None, seed)
        heads.append(state.heads.clone())
    assert all(torch.equal(again, heads[0]) for again in heads) and heads[0].unique().tolist() == [0, 1, 2]


def test_held_out_images_are_judged_by_the_same_heads() -> None:
    """By as large a share: else logits of both would differ by the offset of that head, which losses leave free."""
    made = panel(0.25, Collection(torch.rand(2000, 1, SIZE, SIZE, generator=generator_at(1))))
    state = made.assignment.begin(made, 0)
    assert isinstance(state, PredictedState)
    heads = torch.arange(IMAGES + 2000) % 2
    state._take(heads, heads, None, 3)
    for found in (state.heads, state.held_out_heads):
        assert (found == BINS).float().mean().item() == pytest.approx(0.25, abs=0.04)
        assert set(found.tolist()) == {0, 1, BINS}


def test_the_predictor_learns_the_views_that_samples_have() -> None:
    state = assigned(0.5)
    assert hasattr(state, "trained")
    rows = (state.sampled != state.views).nonzero()[:8, 0]
    fake = torch.rand(8, 1, SIZE, SIZE, generator=generator_at(1))
    expected = F.cross_entropy(state.predictor.train()(fake), state.sampled[rows].long())
    assert state.loss(fake, rows, 0.0).item() == pytest.approx(expected.item(), rel=1e-6)


def test_without_it_nothing_is_kept_nor_judged_beside(monkeypatch: pytest.MonkeyPatch) -> None:
    state = assigned(None)
    assert "sampled" not in state.state_dict() and state.panel.assignment.heads(state.panel) == BINS
    assert torch.equal(seen(state, torch.arange(50), monkeypatch), state.views[:50].long())


def test_what_is_kept_is_loaded_and_checked() -> None:
    state, other = assigned(0.25), assigned(0.25, seed=9)
    other.load_state_dict(state.state_dict())
    assert torch.equal(other.sampled, state.sampled) and other.sampled.dtype == torch.int8
    with pytest.raises(ValueError, match="sampled are not all among 6"):
        other.load_state_dict(state.state_dict() | {"sampled": state.sampled + 6})
