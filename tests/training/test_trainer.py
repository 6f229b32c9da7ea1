"""The trainer: a step is a function of (seed, step), and every configuration goes through the same one."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest
import torch
from comparing import differences, final, stats
from torch import Tensor, nn
from toy import BINS, CHAIRS, SIZE, Layer, toy, with_predicted

from unproject._types import UserError
from unproject.adversarial.augmentation import Augmentation
from unproject.adversarial.penalties import GradientPenalty
from unproject.assignment import Panel, PredictedState, PredictorFit
from unproject.data import batch_rows
from unproject.domains import Domain
from unproject.networks import Discriminator, LowRankGenerator
from unproject.projections.observation import Observation
from unproject.recipes import shape_panels
from unproject.recipes.shapes import shapes, shapes_paper
from unproject.training import Adam, Recipe, checkpoint, load, resume, train, trainer
from unproject.training.distribution import Distribution
from unproject.training.recorder import Recorder
from unproject.training.state import State
from unproject.training.trainer import Trainer
from unproject.training.training_context import TrainingContext

VIEWS = ("predicted", "known", "single", "direct")


def trained(path: Path, **settings: Any) -> Path:
    return train(toy(**{"steps": 4, **settings}), path, quiet=True).path


def test_the_same_seed_gives_the_same_run_and_another_seed_another(tmp_path: Path) -> None:
    a, b, c = (trained(tmp_path / name, seed=seed) for name, seed in (("a", 3), ("b", 3), ("c", 4)))
    assert differences(a, b) == []
    assert "stats.jsonl" in differences(a, c) and "generator/bias" in differences(a, c)


def test_torchs_own_randomness_plays_no_part(tmp_path: Path) -> None:
    """A step that drew from the global generator would differ here, and would move that generator on."""
    torch.manual_seed(1)
    before = torch.get_rng_state()
    a = trained(tmp_path / "a")
    assert torch.equal(before, torch.get_rng_state())
    torch.manual_seed(2)
    assert differences(a, trained(tmp_path / "b")) == []


@pytest.fixture
def without_check(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what parts are given, the steps alone are looked at."""
    monkeypatch.setattr("unproject.training.loop.check_parts", lambda *of: None)


@pytest.mark.usefixtures("without_check")
def test_every_update_draws_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Codes, latents, rows and penalties of every update come from streams of their own."""
    states: list[bytes] = []

    def noted(owner: Any, name: str) -> None:
        method = getattr(owner, name)

        def call(*arguments: Any) -> Any:
            states.extend(a.get_state().numpy().tobytes() for a in arguments if isinstance(a, torch.Generator))
            return method(*arguments)

        monkeypatch.setattr(owner, name, call)

    noted(Panel, "project")
    noted(LowRankGenerator, "draw")
    noted(GradientPenalty, "__call__")
    rows: list[tuple[int, ...]] = []
    monkeypatch.setattr(
        trainer, "batch_rows", lambda *a: (rows.append(tuple(batch_rows(*a).tolist())), batch_rows(*a))[1]
    )
    monkeypatch.setattr(Domain, "write_preview", lambda *_: None)
    monkeypatch.setattr(LowRankGenerator, "sample", lambda *_, **__: torch.empty(0))
    trained(tmp_path, views="known", loss="wasserstein", discriminator_steps=2)
    assert len(states) == len(set(states)) == 4 * 2 * 3
    assert len(rows) == len(set(rows)) == 8


@pytest.mark.parametrize("views", VIEWS)
def test_every_configuration_trains(tmp_path: Path, views: str) -> None:
    run = trained(tmp_path, views=views)
    lines = [line for line in stats(run) if "loss_d" in line]
    assert [line["step"] for line in lines] == [2, 4]
    rounds = [line["round"] for line in stats(run) if line.get("event") == "assigned"]
    assert rounds == ([1, 2, 3] if views == "predicted" else [])
    opened = load(run)
    assert opened.step == 4 and opened.generator.sample(3).shape == (3, SIZE, SIZE, SIZE)
    assert (run / "samples" / "step-000000004.png").stat().st_size > 0


@pytest.mark.parametrize("settings", [{"loss": "wasserstein"}, {"loss": "hinge", "discriminator_steps": 2}])
def test_every_loss_trains(tmp_path: Path, settings: dict[str, Any]) -> None:
    penalties = [line.get("penalty") for line in stats(trained(tmp_path, views="known", **settings))]
    assert all(p is not None for p in penalties) == (settings["loss"] == "wasserstein")


@pytest.mark.usefixtures("without_check")
def test_each_sample_is_projected_several_times(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two samples a batch of four, each in the views of two of the four real images."""
    seen: list[tuple[Tensor, Tensor]] = []
    project = Panel.project

    def noted(panel: Panel, x: Tensor, views: Tensor, *others: Any) -> Tensor:
        seen.append((x.detach().clone(), views))
        return project(panel, x, views, *others)

    monkeypatch.setattr(Panel, "project", noted)
    trained(tmp_path, views="known", batch=4, views_per_sample=2, steps=2)
    for x, views in seen:
        assert torch.equal(x[0], x[1]) and torch.equal(x[2], x[3]) and not torch.equal(x[1], x[2])
        assert len(views) == 4


@pytest.mark.parametrize("views", ["known", "predicted"])
def test_samples_are_projected_in_the_views_of_the_images_they_are_paired_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, views: str
) -> None:
    """Row b of a batch: the sample's view and head are those of real image b, in the discriminator's update too."""
    projected: list[Tensor] = []
    heads: list[Tensor] = []
    reals: list[Tensor] = []
    project, batch, forward = Panel.project, Panel.batch, Discriminator.forward
    monkeypatch.setattr(Panel, "project", lambda p, x, v, *others: (projected.append(v), project(p, x, v, *others))[1])
    monkeypatch.setattr(Panel, "batch", lambda p, rows, *to: (reals.append(rows), batch(p, rows, *to))[1])
    monkeypatch.setattr(Discriminator, "forward", lambda d, y, h: (heads.append(h), forward(d, y, h))[1])
    recipe = toy(views=views, steps=1, loss="hinge", starts=())
    state = State(recipe, torch.device("cpu"))
    assignment = state.panels[0].assignment
    assignment.heads.copy_(assignment.views.flip(0))  # unlike the views, to tell them apart
    with Recorder(tmp_path, quiet=True) as recorder:
        Trainer(recipe, tmp_path, recorder, state, Distribution("cpu")).step()
    (rows,), (views_of_samples,) = reals, projected
    assert torch.equal(views_of_samples, assignment.views[rows]) and len(rows.unique()) == 4
    assert torch.equal(heads[0], assignment.heads[rows].repeat(2)) and torch.equal(heads[1], assignment.heads[rows])


def test_the_predictor_learns_the_views_its_images_were_projected_in(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not those of the bin beside, nor of another image."""
    labelled: list[tuple[Tensor, Tensor]] = []
    projected: list[tuple[Tensor, Tensor]] = []
    found, project = PredictedState._labelled, Panel.project  # pyright: ignore[reportPrivateUsage]

    def noted(state: PredictedState, *arguments: Any) -> tuple[Tensor, Tensor]:
        projected.clear()
        labelled.append(found(state, *arguments))
        return labelled[-1]

    def watched(panel: Panel, x: Tensor, views: Tensor, *others: Any) -> Tensor:
        images = project(panel, x, views, *others)
        projected.append((images.detach(), views))
        return images

    fitted: list[tuple[Tensor, Tensor]] = []
    run = PredictorFit.run
    monkeypatch.setattr(PredictedState, "_labelled", noted)
    monkeypatch.setattr(Panel, "project", watched)
    monkeypatch.setattr(PredictorFit, "run", lambda *a: (fitted.append((a[3], a[4])), run(*a))[1])
    recipe = toy(steps=1, starts=(0.001,))
    state = State(recipe, torch.device("cpu"))
    with Recorder(tmp_path, quiet=True) as recorder:
        trainer = Trainer(recipe, tmp_path, recorder, state, Distribution("cpu"))
        state.panels[0].assignment.before_step(TrainingContext(trainer, 0.5, 0))
    images, views = labelled[0]
    assert torch.equal(images, torch.cat([y for y, _ in projected])[: len(images)])
    assert torch.equal(views, torch.cat([v for _, v in projected])[: len(views)])
    assert torch.equal(fitted[0][0], images) and torch.equal(fitted[0][1], views) and len(views.unique()) == BINS


@dataclass(frozen=True)
class Marked(Augmentation):
    def __call__(self, images: Tensor, rng: torch.Generator) -> Tensor:
        return 2 + images * torch.rand(len(images), 1, 1, 1, generator=rng)


@pytest.mark.usefixtures("without_check")
def test_discriminators_see_nothing_that_is_not_augmented(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In their own update, its penalty and the generator's, real and generated; what is in no image is 2."""
    seen: list[Tensor] = []
    forward = Discriminator.forward

    def noted(discriminator: Discriminator, image: Tensor, head: Tensor) -> Tensor:
        seen.append(image.detach().clone())
        return forward(discriminator, image, head)

    monkeypatch.setattr(Discriminator, "forward", noted)
    recipe = replace(toy(steps=4, views="known"), augmentation=Marked())
    train(recipe, tmp_path / "run", quiet=True)
    assert len(seen) == 4 * 2 + 2 and all(image.min() >= 2 for image in seen)  # and the penalty's, real and generated
    real, fake = seen[0].chunk(2)
    assert not torch.equal(real[0], real[1]) and torch.equal(fake, seen[1])


@pytest.mark.usefixtures("without_check")
def test_the_penalty_is_of_real_and_of_generated_images(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In this order, and of this very batch."""
    penalised: list[tuple[Tensor, Tensor]] = []
    scored: list[Tensor] = []
    penalty, forward = GradientPenalty.__call__, Discriminator.forward
    monkeypatch.setattr(GradientPenalty, "__call__", lambda p, d, *a: (penalised.append(a[:2]), penalty(p, d, *a))[1])
    monkeypatch.setattr(
        Discriminator, "forward", lambda d, y, h: (scored.append(y.detach().clone()), forward(d, y, h))[1]
    )
    trained(tmp_path, views="known", loss="wasserstein", steps=1)
    (real, fake), (from_data, projected) = penalised[0], scored[0].chunk(2)
    assert torch.equal(real, from_data) and torch.equal(fake, projected) and not torch.equal(real, fake)


@pytest.mark.parametrize("views", VIEWS)
@pytest.mark.parametrize("make", [shapes, shapes_paper])
def test_the_recipes_of_the_package_train(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, make: Callable[..., Recipe], views: str
) -> None:
    monkeypatch.setattr(shape_panels, "PROCEDURAL_CHAIRS", 8)
    recipe = make(views=views, size=16, bins=2, views_per_shape=2, channels=8, batch=4, steps=2)
    assert isinstance(recipe.discriminator, partial)
    recipe = recipe.replace(discriminator=partial(recipe.discriminator, channels=4))
    if views == "predicted":
        recipe = with_predicted(recipe, rounds={"starts": (0.5,)}, fit={"images": 32, "steps": 1, "batch": 8})
    assert train(recipe, tmp_path, quiet=True).step == 2


def test_clusters_are_heads(tmp_path: Path) -> None:
    tensors = final(trained(tmp_path, clusters=3))
    assert tensors["discriminators/0.last.weight"].shape[0] == 3
    assert set(tensors["panels/0/assignment/heads"].tolist()) <= {0, 1, 2}
    assert set(tensors["panels/0/assignment/views"].tolist()) <= set(range(BINS))


def test_round_0_has_random_views_and_one_head(tmp_path: Path) -> None:
    tensors = final(trained(tmp_path, starts=(0.99,)))
    assert tensors["panels/0/assignment/heads"].unique().tolist() == [0]
    assert tensors["panels/0/assignment/views"].unique().tolist() == list(range(BINS))


def test_an_initialiser_gives_views_and_heads_before_the_first_step(tmp_path: Path) -> None:
    def initialiser(observations: Sequence[Observation], items: Tensor, seed: int) -> Tensor:
        assert len(observations) == BINS and len(items) == 2 * CHAIRS
        return torch.eye(BINS)[torch.arange(len(items)) % BINS]

    train(with_predicted(toy(steps=2, starts=(0.99,)), initialiser=initialiser), tmp_path, quiet=True)
    tensors = final(tmp_path)
    assert tensors["panels/0/assignment/views"].tolist() == [n % BINS for n in range(2 * CHAIRS)]
    assert torch.equal(tensors["panels/0/assignment/views"], tensors["panels/0/assignment/heads"])
    noted = stats(tmp_path)[0]
    assert noted["event"] == "initialised" and noted["views"] == [2 * CHAIRS // BINS] * BINS


def test_assigning_gives_every_image_the_head_of_its_view(tmp_path: Path) -> None:
    tensors = final(trained(tmp_path, draw="posterior"))
    assert torch.equal(tensors["panels/0/assignment/views"], tensors["panels/0/assignment/heads"])
    assert len(tensors["panels/0/assignment/views"]) == 2 * CHAIRS


def test_restart_begins_round_1_with_fresh_networks_and_keeps_the_assignment(tmp_path: Path) -> None:
    recipe = toy(steps=4, starts=(0.25, 0.5), restart=True)
    state = State(recipe, torch.device("cpu"))
    assignment = state.panels[0].assignment
    with Recorder(tmp_path, quiet=True) as recorder:
        trainer = Trainer(recipe, tmp_path, recorder, state, Distribution("cpu"))
        assert assignment.before_step(TrainingContext(trainer, 0.0, 0)) and assignment.round == 0
        before, optimiser = {k: v.clone() for k, v in state.generator.state_dict().items()}, state.generator_optimiser
        state.counters.step, state.counters.collapsed = 7, 3
        assert assignment.before_step(TrainingContext(trainer, 0.3, 0)) and assignment.round == 1
        assert state.counters.began == 7 and state.counters.collapsed == 0  # the new networks have time to vary
        fresh = State(recipe.replace(seed=recipe.seed + 1), torch.device("cpu"))
        after = state.generator.state_dict()
        assert all(torch.equal(after[k], v) for k, v in fresh.generator.state_dict().items())
        assert not torch.equal(after["mapping.0.weight"], before["mapping.0.weight"])
        assert state.generator_optimiser is not optimiser and not state.generator_optimiser.state
        assert torch.equal(assignment.heads, assignment.views)
        assert assignment.before_step(TrainingContext(trainer, 0.6, 0)) and assignment.round == 2
        assert torch.equal(state.generator.state_dict()["mapping.0.weight"], after["mapping.0.weight"])


def test_a_restarted_run_can_be_loaded_and_resumed(tmp_path: Path) -> None:
    run = trained(tmp_path / "a", restart=True)
    shutil.copytree(run, tmp_path / "b")
    recipe = toy(steps=6, restart=True)
    resume(run, recipe, quiet=True)
    resume(tmp_path / "b", recipe, quiet=True)
    assert differences(run, tmp_path / "b") == [] and load(run).step == 6


def test_bfloat16_trains_and_keeps_its_weights_in_float32(tmp_path: Path) -> None:
    run = trained(tmp_path, precision="bfloat16", steps=2)
    weights = [v for k, v in final(run).items() if k.startswith("generator/") and v.is_floating_point()]
    assert all(v.dtype == torch.float32 and v.isfinite().all() for v in weights)
    assert "generator/bias" in differences(run, trained(tmp_path / "b", steps=2))


def test_compiled_training_agrees_with_plain_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Traced as ever but run by torch's own kernels: those of a C++ compiler take minutes to make."""
    monkeypatch.setattr(torch, "compile", partial(torch.compile, backend="eager"))
    settings: dict[str, Any] = {"restart": True, "steps": 4, "starts": (0.5,)}
    compiled, plain = trained(tmp_path / "a", compile=True, **settings), trained(tmp_path / "b", **settings)
    assert differences(compiled, plain) == []


@pytest.mark.slow
@pytest.mark.skipif(not any(map(shutil.which, ("g++", "c++", "clang++"))), reason="no C++ compiler")
def test_a_small_generator_compiled_for_real(tmp_path: Path) -> None:
    recipe = toy(steps=2, views="known").replace(generator=Layer)
    plain = train(recipe, tmp_path / "a", quiet=True).path
    compiled = train(recipe.replace(compile=True), tmp_path / "b", quiet=True).path
    assert stats(compiled)[0] == pytest.approx(stats(plain)[0], abs=1e-4)


def test_the_budget_is_what_ends_it(tmp_path: Path) -> None:
    assert toy(steps=10, minutes=1.0).progress(5, 0.0) == 0.5
    assert toy(steps=10, minutes=1.0).progress(0, 45.0) == 0.75
    assert trained(tmp_path, steps=3).name and load(tmp_path).step == 3


def test_the_rate_falls_along_a_cosine() -> None:
    adam = Adam(1.0, final=0.0)
    assert [round(adam.rate_at(p), 6) for p in (0.0, 0.5, 1.0, 2.0)] == [1.0, 0.5, 0.0, 0.0]
    assert Adam(0.3).rate_at(0.7) == 0.3


def test_a_second_run_is_not_written_over_the_first(tmp_path: Path) -> None:
    before = final(trained(tmp_path))
    with pytest.raises(UserError, match="holds a run already.*unproject resume"):
        trained(tmp_path, seed=1)
    after = final(tmp_path)
    assert all(torch.equal(before[k], after[k]) for k in before)


def test_a_generator_without_a_name_can_be_trained(tmp_path: Path) -> None:
    """From Python anything that builds a generator will do; only `load` needs to find it by name."""
    recipe = toy(steps=1, views="known")
    run = train(recipe.replace(generator=lambda: recipe.generator()), tmp_path, quiet=True)
    assert run.generator.sample(2).shape == (2, SIZE, SIZE, SIZE)
    with pytest.raises(UserError, match="code outside unproject"):
        load(tmp_path)


def test_the_run_handed_back_is_the_run_on_disk(tmp_path: Path) -> None:
    run = train(toy(steps=2), tmp_path, quiet=True)
    assert torch.equal(run.generator.sample(2, 5), load(tmp_path).generator.sample(2, 5))


def test_rounds_that_come_too_soon_are_left_out(tmp_path: Path) -> None:
    """Of six rounds in twelve steps, those at least four steps after the last one."""
    starts = (0.1, 0.25, 0.4, 0.55, 0.7, 0.85)
    run = train(with_predicted(toy(steps=12, starts=starts), rounds={"least_steps": 4}), tmp_path, quiet=True)
    steps = [line["step"] for line in run.stats() if line.get("event") == "assigned"]
    assert steps == [2, 6, 10]


def test_without_an_average_the_run_holds_the_generator(tmp_path: Path) -> None:
    tensors = final(trained(tmp_path, ema_half_life=0.0, views="known"))
    weights = {name.removeprefix("generator/") for name in tensors if name.startswith("generator/")}
    assert all(torch.equal(tensors[f"average/{name}"], tensors[f"generator/{name}"]) for name in weights)


@pytest.mark.parametrize("wrong", [{"precision": "bf16"}, {"normalise_over": "batch"}])
def test_a_misspelt_choice_is_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(UserError, match=f"{next(iter(wrong))}='.*': choose from"):
        toy(steps=1).replace(**wrong)


def test_what_is_spent_of_steps_is_no_mean_over_processes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rounded, even in double precision, it may be less than the part at which a round begins."""
    with Recorder(tmp_path, quiet=True) as recorder:
        made = Trainer(toy(steps=40), tmp_path, recorder)
        made.state.counters.step = 18
        monkeypatch.setattr(made.distribution, "average", lambda value: value * (1 - 1e-9))
        assert made.progress() == 18 / 40 >= 0.45
        made.recipe = made.recipe.replace(steps=None, minutes=2.0)
        monkeypatch.setattr(made.distribution, "average", lambda seconds: seconds + 60)
        assert made.progress() == pytest.approx(0.5, abs=0.1)


def test_all_processes_draw_the_rows_of_one_clock() -> None:
    """Each has its own; the mean over them says how many steps are left."""
    fake = MagicMock(recipe=toy(steps=1).replace(steps=None, minutes=1.0, batch=4))
    fake.state.counters = SimpleNamespace(step=10, seconds=29.0)
    fake.distribution = SimpleNamespace(world=2, average=lambda seconds: 30.0)
    assert TrainingContext(fake, 0.5, 0).draws(1.0, 1) == range(80, 160)


def test_what_is_frozen_in_a_discriminator_stays_so(tmp_path: Path) -> None:
    recipe = toy(steps=3, views="known")
    whole = recipe.discriminator

    def half_frozen(shape: tuple[int, ...], heads: int) -> nn.Module:
        network = whole(shape, heads)
        next(network.parameters()).requires_grad_(False)
        return network

    recipe = recipe.replace(discriminator=half_frozen)
    frozen, learning = list(State(recipe, torch.device("cpu")).discriminators.named_parameters())[:2]
    train(recipe, tmp_path, quiet=True)
    stored = checkpoint.load(checkpoint.newest(tmp_path / "checkpoints"), "discriminators/")
    assert torch.equal(stored[f"discriminators/{frozen[0]}"], frozen[1])
    assert not torch.equal(stored[f"discriminators/{learning[0]}"], learning[1])
