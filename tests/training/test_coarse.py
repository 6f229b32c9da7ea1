"""A recipe of half the size is trained first, and another one goes on with its weights."""

from __future__ import annotations

import json
import shutil
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from comparing import differences, final
from toy import toy

from unproject._types import UserError
from unproject.adversarial.adaptive import Adaptive
from unproject.adversarial.augmentation import Affine
from unproject.cli import main
from unproject.data import chairs
from unproject.domains import Domain
from unproject.networks import LowRankGenerator, MultiScaleDiscriminator
from unproject.recipes.shapes import shapes
from unproject.training import Coarse, Recipe, checkpoint, load, resume, train
from unproject.training.origin import read_origin, rebuild
from unproject.training.start import grow_from, is_half, start_from
from unproject.training.state import State
from unproject.training.trainer import Trainer

CPU = torch.device("cpu")
STEPS, FIRST = 10, 6
TINY: dict[str, Any] = {"channels": 8, "rank": 4, "batch": 4, "precision": "float32"}


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Domain, "write_preview", lambda *_: None)


@pytest.fixture(autouse=True, scope="module")
def few_and_small() -> Any:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 8)
        patch.setattr("unproject.recipes.coarse.SMALL", 16)  # half of the real one
        patch.setattr("unproject.recipes.coarse.SHARE", 0.6)
        patch.setattr("unproject.training.trainer.EVERY", 2)
        patch.setattr(checkpoint, "KEEP", 20)
        yield


def two_sizes(steps: int = STEPS) -> Recipe:
    """Chairs of 32 voxels a side, six of ten steps at half of it, with a checkpoint each step."""
    return shapes(size=32, views_per_shape=2, steps=steps, checkpoint_every=1, **TINY)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that nothing interrupted."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Domain, "write_preview", lambda *_: None)
        return train(two_sizes(), tmp_path_factory.mktemp("whole") / "run", quiet=True).path


def steps_of(run: Path) -> list[int]:
    return [checkpoint.step_of(path) for path in checkpoint.list_checkpoints(run / "checkpoints")]


def kill(*_: Any, **__: Any) -> None:
    raise KeyboardInterrupt


# How far it is


@pytest.mark.parametrize("share", [0.0, 0.25, 0.6])
def test_the_fine_recipe_begins_its_schedules_where_the_coarse_one_ends(share: float) -> None:
    coarse = Coarse(toy, share)
    assert coarse.fine(share / 2) == coarse.fine(share) == 0 and coarse.fine(1.0) == 1
    for part in (0.1, 0.5, 1.0):
        assert coarse.fine(coarse.spent(part)) == pytest.approx(part)


def test_each_has_its_part_of_steps_and_of_minutes() -> None:
    assert Coarse(toy, 0.6).budget(10, None) == {"steps": 6, "minutes": None}
    assert Coarse(toy, 0.25).budget(None, 8.0) == {"steps": None, "minutes": 2.0}
    assert Coarse(toy, 0.6).budget(1, 8.0) is None and Coarse(toy, 0.0).budget(None, 8.0) is None


@pytest.mark.parametrize("share", [-0.1, 1.0, float("nan")])
def test_a_share_that_leaves_nothing_is_refused(share: float) -> None:
    with pytest.raises(UserError, match="give 0 to below 1"):
        Coarse(toy, share)


def test_progress_is_of_what_is_left() -> None:
    recipe = two_sizes()
    assert [recipe.progress(step, 0.0) for step in (0, 6, 8, 10)] == pytest.approx([0, 0, 0.5, 1])
    assert recipe.steps_until(0.5, step=6, seconds=0.0) == 2
    timed = recipe.replace(steps=None, minutes=10.0)
    assert timed.progress(0, 480.0) == pytest.approx(0.5)
    assert timed.steps_until(0.5, step=100, seconds=400.0) == 20


def test_what_makes_no_recipe_is_refused() -> None:
    with pytest.raises(UserError, match="coarse: made a dict; make a Recipe"):
        two_sizes().replace(coarse=Coarse(dict)).coarse_recipe()


# What is trained


def test_the_fine_run_goes_on_from_the_coarse_one(whole: Path) -> None:
    assert steps_of(whole / "coarse")[-1] == FIRST
    assert steps_of(whole)[-1] == STEPS
    begun, there = checkpoint.load(checkpoint.newest(whole / "checkpoints")), final(whole / "coarse")
    assert begun["counters/began"] == FIRST
    sizes = [json.loads((run / "recipe.json").read_text())["arguments"]["size"] for run in (whole, whole / "coarse")]
    assert sizes == [32, 16]
    state = State(two_sizes(), CPU)
    grow_from(state, whole / "coarse")
    grown = state.tensors()
    assert torch.equal(grown["generator/bias"], there["generator/bias"])
    assert torch.equal(grown["average/mapping.0.weight"], there["average/mapping.0.weight"])
    assert torch.equal(grown["discriminators/0.scales.0.last.weight"], there["discriminators/0.last.weight"])
    for name in ("predictor.layers.0.weight", "trained.layers.0.weight"):
        assert torch.equal(grown[f"panels/0/assignment/{name}"], there["panels/0/assignment/predictor.layers.0.weight"])
    assert state.counters.step == state.counters.began == state.counters.averaged == FIRST
    assert state.counters.seconds == checkpoint.counters_of(checkpoint.newest(whole / "coarse/checkpoints")).seconds


def test_its_seconds_are_those_of_both(whole: Path) -> None:
    coarse, both = (checkpoint.counters_of(checkpoint.newest(run / "checkpoints")) for run in (whole / "coarse", whole))
    assert 0 < coarse.seconds < both.seconds
    assert load(whole).complete and load(whole).sample(1).shape == (1, 32, 32, 32)


def test_the_strength_of_the_augmentation_goes_on(whole: Path, tmp_path: Path) -> None:
    coarse = Path(shutil.copytree(whole / "coarse", tmp_path / "coarse"))
    newest = checkpoint.newest(coarse / "checkpoints")
    tensors = checkpoint.load(newest)
    tensors["panels/0/augmentation/strength"].fill_(0.4)
    tensors["panels/0/augmentation/moved_at"].fill_(0.9)
    checkpoint.save(coarse / "checkpoints", FIRST, tensors)
    state = State(two_sizes(), CPU)
    grow_from(state, coarse)
    augmentation = state.panels[0].augmentation
    assert augmentation is not None
    assert (augmentation.get_buffer("strength"), augmentation.get_buffer("moved_at")) == (0.4, 0.0)


def test_sizes_in_between_are_trained_too(tmp_path: Path) -> None:
    recipe = shapes(size=64, views_per_shape=2, steps=10, **TINY)
    middle = recipe.coarse_recipe()
    assert middle is not None and middle.steps == 6 and middle.panels[0].shape[-1] == 32
    least = middle.coarse_recipe()
    assert least is not None and least.steps == 3 and least.panels[0].shape[-1] == 16 and least.coarse is None
    discriminator = recipe.discriminator((1, 64, 64), 16)
    assert isinstance(discriminator, MultiScaleDiscriminator) and len(discriminator.scales) == 3
    run = train(recipe, tmp_path / "run", quiet=True)
    assert run.step == 10 and steps_of(tmp_path / "run/coarse/coarse")[-1] == 3


# Stopped and killed


@pytest.mark.parametrize("step", [0, 2, FIRST, 8])
def test_killed_at_any_step_it_goes_on_bit_for_bit(whole: Path, tmp_path: Path, step: int) -> None:
    """What is left is what a kill leaves: of the coarse run the checkpoints until then, of the fine run none before."""
    killed = Path(shutil.copytree(whole, tmp_path / "killed"))
    for run in (killed, killed / "coarse"):
        for path in checkpoint.list_checkpoints(run / "checkpoints"):
            if checkpoint.step_of(path) > step:
                path.unlink()
    if step <= FIRST:
        shutil.rmtree(killed / "checkpoints")
        (killed / "checkpoints").mkdir()
        (killed / "stats.jsonl").write_text("")
    assert resume(killed, quiet=True).step == STEPS
    assert differences(whole, killed) == [] and differences(whole / "coarse", killed / "coarse") == []


def test_killed_before_the_coarse_run_was_made_it_goes_on(whole: Path, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("unproject.training.loop._trained_coarse", kill)
        with pytest.raises(KeyboardInterrupt):
            train(two_sizes(), tmp_path / "killed", quiet=True)
    assert resume(tmp_path / "killed", quiet=True).step == STEPS
    assert differences(whole, tmp_path / "killed") == []


def test_stopped_in_the_coarse_run_it_is_incomplete(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trainer, "stopping", lambda self: self.state.counters.step == 3)
        run = train(two_sizes(), tmp_path / "run", quiet=True)
        assert not run.complete and run.step == 0 and steps_of(tmp_path / "run/coarse") == [1, 2, 3]
        assert not resume(tmp_path / "run", quiet=True).complete
    assert main(["resume", str(tmp_path / "run"), "--quiet", "--steps", "5"]) == 0
    assert steps_of(tmp_path / "run")[-1] == 5


def test_the_command_says_where_it_was_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flags = [word for name, value in TINY.items() for word in (f"--{name}", str(value))]
    monkeypatch.setattr(Trainer, "stopping", lambda self: self.state.counters.step == 3)
    run = str(tmp_path / "run")
    assert main(["train", "shapes", "--size", "32", "--steps", "10", *flags, "--out", run]) == 0
    said = capsys.readouterr().out
    assert f"{run}/coarse is trained first, at half the size, for 60% of the budget" in said
    assert f"{run}: stopped in coarse/, at half the size; unproject resume {run} goes on" in said
    assert main(["resume", run, "--quiet"]) == 0
    assert capsys.readouterr().out == f"{run}: 0 steps\n"


def test_a_larger_budget_is_of_both(whole: Path, tmp_path: Path) -> None:
    run = Path(shutil.copytree(whole, tmp_path / "run"))
    assert resume(run, steps=12, quiet=True).step == 12
    assert steps_of(run / "coarse")[-1] == FIRST


def test_what_fails_at_full_size_leaves_the_coarse_run(tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("unproject.training.loop.grow_from", failing)
        with pytest.raises(RuntimeError):
            train(two_sizes(), tmp_path / "run", quiet=True)
    assert steps_of(tmp_path / "run/coarse")[-1] == FIRST
    assert resume(tmp_path / "run", quiet=True).step == STEPS


def test_what_fails_before_the_first_step_leaves_nothing(tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Trainer, "step", failing)
        with pytest.raises(RuntimeError):
            train(two_sizes(), tmp_path / "run", quiet=True)
    assert not (tmp_path / "run").exists()


def failing(*_: Any) -> None:
    raise RuntimeError("no memory")


def test_a_folder_named_coarse_that_is_there_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "coarse").mkdir()
    (tmp_path / "coarse/notes.txt").write_text("mine")
    with pytest.raises(UserError, match="is there already"):
        train(two_sizes(), tmp_path, quiet=True)


# With the weights of another run


def test_a_run_that_starts_from_another_trains_at_full_size_alone(whole: Path, tmp_path: Path) -> None:
    run = train(two_sizes(), tmp_path / "run", start=whole, quiet=True)
    assert run.step == STEPS and not (run.path / "coarse").exists() and steps_of(run.path)[0] >= 0
    assert resume(run.path, steps=12, quiet=True).step == 12
    other = train(two_sizes(), tmp_path / "killed", start=whole, quiet=True)
    for path in checkpoint.list_checkpoints(other.path / "checkpoints")[1:]:
        path.unlink()
    assert resume(other.path, quiet=True).step == STEPS
    assert differences(other.path, train(two_sizes(), tmp_path / "again", start=whole, quiet=True).path) == []


def test_a_run_of_half_the_size_can_be_started_from(whole: Path) -> None:
    state = State(two_sizes(), CPU)
    noted = start_from(state, whole / "coarse")
    assert noted["panels"] == [{"discriminator": True, "views": True}]
    assert state.counters.step == 0
    assert torch.equal(state.tensors()["generator/bias"], final(whole / "coarse")["generator/bias"])


def test_one_that_cannot_grow_says_why(whole: Path) -> None:
    recipe = two_sizes()
    generator = partial(LowRankGenerator, size=32, channels=8, rank=8)
    with pytest.raises(UserError, match="coarse: cannot start from it"):
        start_from(State(recipe.replace(generator=generator), CPU), whole / "coarse")


HALF: dict[str, Any] = {"call": "a", "arguments": {"size": 32, "rank": 4, "hull": 1.0}}


@pytest.mark.parametrize(
    "arguments, half",
    [
        ({"size": 64, "rank": 4}, True),
        ({"size": 64, "rank": 8}, False),
        ({"size": 128, "rank": 4}, False),
        ({"size": 32, "rank": 4}, False),
        ({"rank": 4}, False),
    ],
)
def test_half_the_size_and_alike_in_all_else(arguments: dict[str, Any], half: bool) -> None:
    assert is_half(HALF, {"call": "a", "arguments": arguments}) == half
    assert not is_half(HALF, {"call": "b", "arguments": arguments})
    assert not is_half("damaged", {"call": "a", "arguments": arguments})


# The recipe of shapes


@pytest.fixture
def volumes(tmp_path: Path) -> Path:
    np.savez(tmp_path / "volumes.npz", volume=chairs(8, 32).numpy() > 0.5)
    return tmp_path / "volumes.npz"


def made(volumes: Path, **arguments: Any) -> Recipe:
    return shapes(data=volumes, **{"size": 32, "views_per_shape": 2, "steps": 10, **TINY, **arguments})


@pytest.mark.parametrize("views", ["predicted", "learned", "known", "single"])
def test_silhouettes_of_twice_the_least_size_begin_with_it(volumes: Path, views: str) -> None:
    recipe = made(volumes, views=views, solid=0.2)
    coarse = recipe.coarse_recipe()
    assert coarse is not None and coarse.panels[0].shape[-1] == 16 and coarse.steps == 6
    assert coarse.origin is not None and coarse.origin.arguments["views"] == views
    assert recipe.generator_optimiser.rate == coarse.generator_optimiser.rate / 2
    assert recipe.discriminator_optimiser.final == pytest.approx(coarse.generator_optimiser.rate / 20)
    assert recipe.tries is None and (coarse.tries is None) == (views != "predicted")
    assert all(name in repr(recipe.regulariser) for name in ("Solid(weight=0.02, final=0.002", "Connected(weight=3.0"))
    assert ("Rectilinear(weight=0.3, final=0.09" in repr(recipe.regulariser)) == (views != "known")
    assert isinstance(recipe.augmentation, Adaptive) and isinstance(recipe.augmentation.augmentation, Affine)


@pytest.mark.parametrize(
    "arguments", [{"size": 16}, {"views": "direct"}, {"channels": 64}, {"coarse_to_fine": False}], ids=str
)
def test_others_do_not(volumes: Path, arguments: dict[str, Any]) -> None:
    recipe = made(volumes, **arguments)
    assert recipe.coarse is None and (recipe.tries is None) == ("views" in arguments)
    assert recipe.generator_optimiser.rate == 1.5e-3


def test_a_run_of_before_goes_on_as_it_was(volumes: Path, tmp_path: Path) -> None:
    run = train(made(volumes, coarse_to_fine=False, steps=1), tmp_path / "run", quiet=True)
    file = run.path / "recipe.json"
    content = json.loads(file.read_text())
    del content["arguments"]["coarse_to_fine"]
    file.write_text(json.dumps(content))
    assert rebuild(read_origin(run.path)).coarse is None
    assert resume(run.path, steps=2, quiet=True).step == 2


def test_a_run_of_now_is_rebuilt_in_two_sizes(whole: Path) -> None:
    assert rebuild(read_origin(whole)).coarse is not None


def test_the_least_size_is_32(volumes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.recipes.coarse.SMALL", 32)
    assert made(volumes).coarse is None
    coarse = made(volumes, size=64).coarse_recipe()
    assert coarse is not None and coarse.panels[0].shape[-1] == 32
