"""Views predicted jointly: what reaches the generator and the predictor, when, and how rounds assign views."""

from __future__ import annotations

import copy
import math
from dataclasses import replace
from functools import partial
from typing import Any

import pytest
import torch
import torch.nn.functional as F
from torch import Tensor

from unproject._random import generator_at, seeded
from unproject._types import UserError
from unproject.assignment import Estimator, JointlyPredicted, JointlyPredictedState, Panel, PredictorFit, Rounds
from unproject.assignment.jointly_predicted import AVERAGED, COMPLETE, LEAST_BALANCE, MEMORY
from unproject.assignment.view_findings import information
from unproject.data import Collection
from unproject.networks import ViewPredictor
from unproject.projections.silhouette import Silhouette, azimuth_bins, mirrored_views

BINS, SIZE = 6, 16
FIT = PredictorFit(partial(ViewPredictor, channels=4))


def begun(mirrored: bool = False, **settings: Any) -> JointlyPredictedState:
    """The state of a panel of six views and 24 images of noise; nothing falls and nothing is capped unless asked."""
    fit = replace(FIT, mirrored=mirrored_views(BINS) if mirrored else None)
    views = azimuth_bins(BINS, Silhouette(size=SIZE))
    images = Collection(torch.rand(24, 1, SIZE, SIZE, generator=generator_at(0)))
    assignment = JointlyPredicted(Rounds((0.5,)), fit, **{"fall": (1.0, 2.0), "margin": 9.0, **settings})
    panel = Panel(views, images, assignment)
    with seeded(0, "predictor"):
        state = panel.assignment.begin(panel, 0)
    assert isinstance(state, JointlyPredictedState)
    return state


def fakes() -> tuple[Tensor, Tensor]:
    """Eight projections, and the rows they are paired with."""
    return torch.rand(8, 1, SIZE, SIZE, generator=generator_at(1)).requires_grad_(), torch.arange(8) * 3


def same(count: Any, other: Any) -> bool:
    return all(torch.equal(a, b) for a, b in zip(count, other, strict=True))


class Alone:
    """The only process: what it averages is noted, and stays as it is."""

    def __init__(self) -> None:
        self.averaged: list[torch.nn.Module] = []
        self.means: list[Tensor] = []

    def average_gradients(self, module: torch.nn.Module) -> None:
        self.averaged.append(module)

    def mean(self, values: Tensor) -> Tensor:
        self.means.append(values)
        return values


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("weight", [0.0, 0.25, 2.0])
def test_the_generator_gets_w_times_the_gradient_and_the_predictor_all(weight: float, mirrored: bool) -> None:
    state, (fake, rows) = begun(mirrored, weight=weight), fakes()
    predictor, images, views = copy.deepcopy(state.predictor).train(), fake.detach().clone(), state.views[rows].long()
    images.requires_grad_()
    flipped = torch.cat([images[:4], images[4:].flip(-1)]) if mirrored else images
    labels = torch.cat([views[:4], (-views[4:]) % BINS]) if mirrored else views
    expected = F.cross_entropy(predictor(flipped), labels)
    expected.backward()
    loss = state.loss(fake, rows, 0.0)
    loss.backward()
    assert loss.item() == pytest.approx(expected.item(), rel=1e-6) and fake.grad is not None
    torch.testing.assert_close(fake.grad, weight * images.grad)  # pyright: ignore[reportOptionalOperand]
    for p, q in zip(state.predictor.parameters(), predictor.parameters(), strict=True):
        torch.testing.assert_close(p.grad, q.grad)


def test_a_predictor_that_steers_nothing_still_learns() -> None:
    state, (fake, rows) = begun(weight=0.0, rate=0.01), fakes()
    losses = []
    for _ in range(30):
        loss = state.loss(fake, rows, 0.0)
        losses.append(loss.item())
        loss.backward()
        state.update(Alone())
    assert losses[-1] < 0.3 * losses[0]
    assert fake.grad is not None and not fake.grad.any()


def test_an_update_is_a_step_of_averaged_gradients() -> None:
    """With a rate of Adam's first step, and nothing left for the next one."""
    state, (fake, rows) = begun(rate=0.01), fakes()
    before = [p.detach().clone() for p in state.predictor.parameters()]
    state.loss(fake, rows, 0.0).backward()
    processes = Alone()
    state.update(processes)
    parameters = list(state.trained.parameters())
    assert [*map(id, processes.averaged)] == [id(state.trained)]
    assert [*map(id, processes.means)] == [id(state.of_fakes)]
    assert max(float((p - q).detach().abs().max()) for p, q in zip(parameters, before)) == pytest.approx(0.01, rel=1e-3)
    assert all(p.grad is None or not p.grad.any() for p in parameters)


def test_images_are_assigned_by_the_average_of_predictors() -> None:
    """Weights and batch statistics both; a resumed state and a run that starts from it have both predictors."""
    state, (fake, rows) = begun(rate=0.01), fakes()
    mean = {name: value.double().clone() for name, value in state.predictor.state_dict().items()}
    for _ in range(3):
        state.loss(fake, rows, 0.0).backward()
        state.update(Alone())
        for name, new in state.trained.state_dict().items():
            mean[name] = (
                new.double() if new.dtype == torch.int64 else mean[name] + AVERAGED * (new.double() - mean[name])
            )
    for name, value in state.predictor.state_dict().items():
        torch.testing.assert_close(value.double(), mean[name], atol=1e-6, rtol=0)
    images = torch.rand(5, 1, SIZE, SIZE, generator=generator_at(3))
    assert torch.equal(state._of(images), FIT.probabilities(state.predictor, [images]))  # pyright: ignore[reportPrivateUsage]
    state.round.fill_(1)
    other = begun()
    assert other.take_over(state.state_dict())
    for name, value in other.trained.state_dict().items():
        assert torch.equal(value, state.predictor.state_dict()[name])


@pytest.mark.parametrize(
    "progress, share", [(0.0, 1.0), (0.2, 1.0), (0.3, 0.75), (0.5, 0.25), (0.6, 0.0), (1.0, 0.0), (1.3, 0.0)]
)
def test_the_weight_falls_in_a_straight_line(progress: float, share: float) -> None:
    state, (fake, rows) = begun(weight=0.4, fall=(0.2, 0.6)), fakes()
    assert state.generator_weight(progress) == pytest.approx(0.4 * share, abs=1e-9)
    state.loss(fake, rows, progress).backward()
    assert fake.grad is not None and bool(fake.grad.any()) == (share > 0)


@pytest.mark.parametrize(
    "fakes_know, early, late",
    [
        (0.0, 1, 0),
        (0.7, 1, 0),
        (0.8, 0.75, 0),
        (1.0, 0.25, 0),
        (1.1, 0, 0),
        (1.2, 0, -0.25),
        (1.5, 0, -1),
        (2.5, 0, -1),
    ],
)
def test_projections_may_tell_as_much_as_pictures_do(fakes_know: float, early: float, late: float) -> None:
    """More is not asked for while views are sought, and taken back when they are found."""
    state = begun(weight=0.4, margin=0.4, fall=(0.2, 0.6))
    state.of_data.fill_(0.7)
    state.of_fakes.fill_(fakes_know)
    for progress, share in ((0.0, early), (0.2, early), (0.4, (early + late) / 2), (0.6, late), (1.3, late)):
        assert state.generator_weight(progress) == pytest.approx(0.4 * share, abs=1e-6)


def of_views(state: JointlyPredictedState, mirrored: bool = False) -> float:
    """The entropy of the views in use."""
    counts = torch.bincount(state.views.long(), minlength=BINS).double()
    counts = counts + counts[list(mirrored_views(BINS))] if mirrored else counts
    shares = counts / counts.sum()
    return -(shares * shares.clamp_min(1e-9).log()).sum().item()


def test_what_projections_tell_is_the_entropy_of_views_minus_the_cross_entropy() -> None:
    state, (fake, rows) = begun(), fakes()
    expected = 0.0
    for _ in range(3):
        loss = state.loss(fake, rows, 0.0).item()
        expected += MEMORY * (of_views(state) - loss - expected)
    assert state.of_fakes.item() == pytest.approx(expected, rel=1e-5)
    assert state.log()["view_information"] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("mirrored", [False, True])
def test_views_that_are_always_the_same_tell_nothing(mirrored: bool) -> None:
    """log K minus the cross entropy is log K there, whatever pictures show."""
    state, (fake, rows) = begun(mirrored), fakes()
    state.views.fill_(2)
    for _ in range(400):
        state.loss(fake, rows, 0.0).backward()
        state.update(Alone())  # type: ignore[arg-type]
    told = math.log(2) if mirrored else 0.0  # which half of the images was flipped
    assert state.of_fakes.item() <= told + 1e-3


class Run:
    """What a round needs of a run."""

    step, progress = 7, 0.6
    device = torch.device("cpu")

    def __init__(self) -> None:
        self.generator, self.lines = torch.nn.Linear(1, 1), []

    def synchronise(self, _: Any) -> None: ...

    def record(self, **fields: Any) -> None:
        self.lines.append(fields)


def test_a_round_assigns_by_the_predictor_as_it_is() -> None:
    """No fit; the predictor as in evaluation, so that the other images of a batch play no part."""
    state, (fake, rows) = begun(mirrored=True, estimator=Estimator("argmax")), fakes()
    state.loss(fake, rows, 0.0)
    before, run = copy.deepcopy(list(state.predictor.parameters())), Run()
    state.of_fakes.fill_(0.3)
    expected = of_views(state, mirrored=True) - 0.3
    assert state.before_step(run)  # type: ignore[arg-type]
    p = state.settings.fit.probabilities(state.predictor.eval(), [state.panel.batch(torch.arange(24))])
    assert torch.equal(state.views, p.argmax(1)) and same(before, state.predictor.parameters())
    assert state.of_data.item() == pytest.approx(information(p), rel=1e-4) and state.of_data > 0
    (line,) = run.lines
    assert line["round"] == 1 and line["loss"] == pytest.approx(expected, abs=1e-5)
    assert (int(state.round), int(state.fitting), int(state.last)) == (1, 0, 7)
    assert state.before_step(run) and len(run.lines) == 1  # type: ignore[arg-type]


def test_checks_change_nothing_that_training_sees() -> None:
    state, (fake, rows) = begun(), fakes()
    buffers = copy.deepcopy(dict(state.predictor.named_buffers()))
    assert state.checks()["view_information"].value >= 0
    assert same(buffers.values(), state.predictor.buffers())
    state.loss(fake, rows, 0.0)
    assert state.trained.training


@pytest.mark.parametrize(
    "wrong", [{"weight": -1}, {"fall": (0.6, 0.2)}, {"fall": (-0.1, 0.2)}, {"margin": 0}, {"rate": 0}], ids=str
)
def test_settings_that_make_no_sense(wrong: dict[str, Any]) -> None:
    with pytest.raises(UserError, match="give a weight of 0 or more"):
        JointlyPredicted(**wrong)


@pytest.mark.parametrize("told, balanced", [(0.0, True), (1.0, False)])
def test_views_are_balanced_the_less_the_more_pictures_tell(told: float, balanced: bool) -> None:
    """Pictures that all show view 0 or 1 stay there if they are told apart, and are spread if nothing is known."""
    state = begun()
    state.settings = replace(state.settings, estimator=Estimator("posterior", balance=1.0))
    sure = F.one_hot(torch.arange(24) % 4, BINS).float()
    vague = torch.full((24, BINS), 0.02)
    vague[:, 0] = 1 - 0.02 * (BINS - 1)
    p = sure if told else vague
    found = state._responsibilities(p.clone())  # pyright: ignore[reportPrivateUsage]
    assert state.of_data.item() == pytest.approx(information(p))
    wanted = torch.full((BINS,), 1 / BINS) if balanced else p.mean(0)
    torch.testing.assert_close(found.mean(0), wanted, atol=1e-3, rtol=0)
    state.round.fill_(1)
    state._responsibilities(torch.full((24, BINS), 1 / BINS))  # pyright: ignore[reportPrivateUsage]
    assert state.of_data.item() == pytest.approx(0.5 * information(p), abs=1e-6)


@pytest.mark.parametrize("beyond, less", [(-0.3, 0.0), (0.2, 0.2), (2.0, 2.0)])
def test_a_try_whose_projections_tell_more_than_pictures_is_worth_less(beyond: float, less: float) -> None:
    state = begun(margin=0.4)
    p = F.one_hot(torch.arange(24) % 4, BINS).float()
    state._probabilities = lambda rows: p.clone()  # pyright: ignore[reportPrivateUsage]
    state.of_fakes.fill_(information(p) + beyond)
    assert state.merit() == pytest.approx(information(p) - less, abs=1e-5)


def test_a_little_of_the_balance_is_always_left() -> None:
    """Views that look alike would drift apart: m becomes m^(1 - 1/4), if the balance is 1 and all is told."""
    state = begun()
    state.settings = replace(state.settings, estimator=Estimator("posterior", balance=1.0))
    p = torch.full((25, BINS), 1e-4)
    p[torch.arange(25), torch.arange(25) % 5 % BINS] = 0.55
    p[torch.arange(25), (torch.arange(25) % 5 + 1) % BINS] = 0.45
    p[:10] = p[:1]
    found = state._responsibilities(p / p.sum(1, keepdim=True)).mean(0)  # pyright: ignore[reportPrivateUsage]
    own = (p / p.sum(1, keepdim=True)).mean(0)
    known = min(1.0, state.of_data.item() / (COMPLETE * math.log(BINS)))
    wanted = own ** (1 - max(LEAST_BALANCE, 1 - known))
    assert 1 - known < LEAST_BALANCE
    torch.testing.assert_close(found, wanted / wanted.sum(), atol=2e-3, rtol=0)


def test_views_are_mirrored_to_views_that_are_there() -> None:
    with pytest.raises(UserError, match=r"mirrored=\(0, 1\)\): give each of 0 to 5, the observations, once"):
        panel = begun().panel
        replace(panel, assignment=JointlyPredicted(fit=replace(FIT, mirrored=(0, 1)))).assignment.begin(panel, 0)


def test_no_gradient_is_asked_for_through_a_threshold() -> None:
    with pytest.raises(UserError, match="no gradient passes through binarise"):
        JointlyPredicted(fit=replace(FIT, binarise=True))
    assert JointlyPredicted(fit=replace(FIT, binarise=True), weight=0).weight == 0
