"""A run killed at any instant and resumed is the run that was never killed, bit for bit."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import torch
from comparing import differences, final, stats, temporaries
from torch import Tensor
from torch.nn.functional import dropout
from toy import jointly, only_panel, toy, with_panel, with_predicted

from unproject._types import UserError
from unproject.assignment import Estimator, JointlyPredictedState, PredictedState, PredictorFit, predicted
from unproject.data import Collection
from unproject.domains import Domain
from unproject.networks import LowRankGenerator, ViewPredictor
from unproject.report.contents import read_contents
from unproject.training import Adam, Recipe, Tries, checkpoint, load, lock, resume, run_directory, train, trainer
from unproject.training.trainer import Trainer

# Rounds begin at odd steps and checkpoints are of even ones: what a round decided must come out of a checkpoint.
STARTS = (0.3, 0.55, 0.8)
RECIPE = toy(steps=8, checkpoint_every=2, starts=STARTS)


@pytest.fixture(autouse=True)
def no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """They would take half of the time."""
    monkeypatch.setattr(Domain, "write_preview", lambda *_: None)


class Killed(BaseException):
    """Stands for SIGKILL where the instant must be exact: nothing in the package catches it and goes on."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run that nothing ever stopped."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trainer, "EVERY", 2)
        return train(RECIPE, tmp_path_factory.mktemp("whole") / "run", quiet=True).path


def at_call(patch: pytest.MonkeyPatch, owner: object, name: str, number: int, act: Callable[[], object]) -> None:
    """Run `act` right before the `number`-th call of `owner.name`."""
    method, calls = getattr(owner, name), 0

    def counted(*arguments: object, **named: object) -> object:
        nonlocal calls
        calls += 1
        if calls == number:
            act()
        return method(*arguments, **named)

    patch.setattr(owner, name, counted)


def die() -> None:
    raise Killed


@pytest.mark.slow
def test_ten_kills_with_sigkill(tmp_path: Path, forked: None) -> None:
    script = Path(__file__).with_name("killing.py")
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [sys.executable, str(script), str(tmp_path), "0"], env=environment, capture_output=True, text=True, timeout=250
    )
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.split()) == 10
    print("the kills interrupted:", *done.stdout.split())
    for killed in tmp_path.glob("killed-*"):
        assert differences(tmp_path / "whole", killed) == []
        assert temporaries(killed) == []


INSTANTS = [
    (Trainer, "_project", 1),  # before the first checkpoint
    (Trainer, "_update_generator", 6),
    (PredictorFit, "probabilities", 2),  # between fitting the predictor and using it
    (Estimator, "assign", 3),
    (checkpoint, "save_file", 3),
    (os, "replace", 5),  # the file is written but has no name yet
    (Domain, "write_preview", 3),  # the checkpoint is there, its picture is not
    (run_directory, "write_json", 2),  # recipe.json was never written
]


@pytest.mark.parametrize("owner, name, number", INSTANTS, ids=lambda v: v if isinstance(v, str) else "")
def test_killed_at_an_exact_instant(whole: Path, tmp_path: Path, owner: object, name: str, number: int) -> None:
    run = tmp_path / "run"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "unlink", lambda *_, **__: None)  # a killed process tidies nothing
        at_call(patch, owner, name, number, die)
        with pytest.raises(Killed):
            train(RECIPE, run, quiet=True)
    if (run / "recipe.json").exists():
        resume(run, RECIPE, quiet=True)
    else:
        train(RECIPE, run, quiet=True)
    assert differences(whole, run) == []


def test_what_a_killed_save_left_is_removed(tmp_path: Path) -> None:
    train(toy(steps=2), tmp_path, quiet=True)
    of_ours = [tmp_path / "checkpoints" / ".step-000000004.0a1b2c3d.tmp.safetensors", tmp_path / ".stats.0a.tmp.jsonl"]
    left = [*of_ours, tmp_path / "checkpoints" / ".tmp9o543H"]  # the last one as safetensors names its own
    for path in left:
        path.write_bytes(b"half")
    resume(tmp_path, toy(steps=4), quiet=True)
    assert temporaries(tmp_path) == []


def test_a_torn_last_line_is_dropped(whole: Path, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        at_call(patch, Trainer, "_update_generator", 6, die)
        with pytest.raises(Killed):
            train(RECIPE, tmp_path, quiet=True)
    with (tmp_path / "stats.jsonl").open("a") as file:
        file.write('{"step": 6, "seco')
    resume(tmp_path, RECIPE, quiet=True)
    assert stats(tmp_path) == stats(whole)


def test_a_clock_that_jumps(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Back and forth by a year, as after a wrong date was set: neither numbers nor a run's seconds take notice."""
    clock, calls = time.time, iter(range(1_000_000))
    monkeypatch.setattr(time, "time", lambda: clock() + 3e7 * (-1) ** next(calls))
    monkeypatch.setattr(trainer, "EVERY", 2)
    train(RECIPE, tmp_path / "run", quiet=True)
    checkpoint.newest(tmp_path / "run" / "checkpoints").unlink()
    resume(tmp_path / "run", RECIPE, quiet=True)
    assert not differences(whole, tmp_path / "run")
    seconds = [json.loads(line)["seconds"] for line in (tmp_path / "run" / "stats.jsonl").read_text().splitlines()]
    assert seconds == sorted(seconds) and 0 < seconds[-1] < 600


def test_a_finished_run_resumes_to_itself(whole: Path) -> None:
    before, lines = final(whole), stats(whole)
    run = resume(whole, RECIPE, quiet=True)
    after = final(whole)
    assert run.step == 8 and stats(whole) == lines
    assert all(torch.equal(before[name], after[name]) for name in before)


def test_a_larger_budget_goes_on(tmp_path: Path) -> None:
    train(toy(steps=4), tmp_path, quiet=True)
    assert resume(tmp_path, toy(steps=6, checkpoint_every=3), quiet=True).step == 6
    assert [p.name for p in checkpoint.list_checkpoints(tmp_path / "checkpoints")] == [
        "step-000000004.safetensors",
        "step-000000006.safetensors",
    ]


@pytest.mark.parametrize("joint", [False, True])
def test_a_larger_budget_has_rounds_of_its_own(tmp_path: Path, joint: bool) -> None:
    """They come as often as if the budget had been the larger one from the start; a budget that stays changes none."""
    recipe = toy(steps=20, starts=tuple(k / 10 for k in range(1, 10)), draw="posterior")
    recipe = jointly(recipe) if joint else recipe
    train(recipe, tmp_path / "run", quiet=True)
    resume(tmp_path / "run", recipe, steps=40, quiet=True)
    whole = train(recipe.replace(steps=40), tmp_path / "whole", quiet=True).path
    steps, at_once = ([line["step"] for line in rounds(run)] for run in (tmp_path / "run", whole))
    assert at_once == [4, 8, 12, 16, 20, 24, 28, 32, 36]
    assert steps == [2, 4, 6, 8, 10, 12, 14, 16, 18] + [24, 28, 32, 36]
    numbers = [line["round"] for line in rounds(tmp_path / "run")]
    assert numbers[:9] == list(range(1, 10)) and len(set(numbers)) == len(numbers), "a number is a seed"


def test_rounds_go_on_if_the_budget_grew_beyond_the_first_of_them(tmp_path: Path) -> None:
    """None is due yet in the larger one, but there is a predictor, which is not asked for initial views again."""
    recipe = toy(steps=4, starts=(0.5,))
    train(recipe, tmp_path, quiet=True)
    resume(tmp_path, recipe, steps=16, quiet=True)
    assert [line["step"] for line in rounds(tmp_path)] == [2, 8]
    assert [type(state.view_probabilities()) for state in load(tmp_path, trust=True).assignments()] == [Tensor]


def rounds(run: Path) -> list[dict[str, Any]]:
    return [line for line in stats(run) if line.get("event") == "assigned"]


def test_a_budget_in_minutes_ends_with_a_checkpoint(tmp_path: Path) -> None:
    run = train(toy(minutes=0.02), tmp_path, quiet=True)
    assert run.step > 0 and load(tmp_path).step == run.step
    assert resume(tmp_path, toy(minutes=0.02), quiet=True).step == run.step


@pytest.fixture
def forty_seconds_a_checkpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    """And none for all else."""
    clock, save = [0.0], checkpoint.save

    def slowly(*given: Any) -> Path:
        clock[0] += 40
        return save(*given)

    monkeypatch.setattr(Trainer, "seconds", property(lambda _: clock[0]))
    monkeypatch.setattr(trainer.checkpoint, "save", slowly)


def test_minutes_that_end_while_a_checkpoint_is_written_are_spent_in_that_checkpoint(
    tmp_path: Path, forty_seconds_a_checkpoint: None
) -> None:
    """Else a run that said it was finished would load as stopped."""
    run = train(toy(minutes=1.0, checkpoint_every=1), tmp_path, quiet=True)
    assert run.step == 2 and run.complete and load(tmp_path).complete


def test_a_run_that_is_stopped_is_unfinished_though_its_minutes_end_while_it_is_saved(
    tmp_path: Path, forty_seconds_a_checkpoint: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else it would have a verdict, and load as stopped."""
    with monkeypatch.context() as patch:
        at_call(patch, Trainer, "step", 2, interrupt)
        run = train(toy(minutes=0.5, checkpoint_every=9), tmp_path, quiet=True)
    assert run.step == 2 and not run.complete and not load(tmp_path).complete


def interrupt() -> None:
    signal.raise_signal(signal.SIGINT)


@contextmanager
def heard_by(number: int, handler: signal.Handlers) -> Iterator[None]:
    before = signal.signal(number, handler)
    try:
        yield
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_first_ctrl_c_saves_and_leaves(whole: Path, tmp_path: Path, number: int) -> None:
    with heard_by(number, signal.SIG_DFL), pytest.MonkeyPatch.context() as patch:  # under nohup SIGHUP is ignored
        at_call(patch, Trainer, "_update_generator", 7, lambda: signal.raise_signal(number))
        run = train(RECIPE, tmp_path, quiet=True)
        assert signal.getsignal(number) is signal.SIG_DFL
    assert run.step == 7 and load(tmp_path).step == 7
    assert resume(tmp_path, RECIPE, quiet=True).step == 8
    assert differences(whole, tmp_path) == []


def test_a_closed_terminal_does_not_end_what_nohup_began(tmp_path: Path) -> None:
    with heard_by(signal.SIGHUP, signal.SIG_IGN), pytest.MonkeyPatch.context() as patch:
        at_call(patch, Trainer, "_update_generator", 7, lambda: signal.raise_signal(signal.SIGHUP))
        assert train(RECIPE, tmp_path, quiet=True).step == 8


@pytest.mark.parametrize(
    "numbers",
    [
        (signal.SIGTERM, signal.SIGTERM, signal.SIGTERM),
        (signal.SIGHUP, signal.SIGTERM),
        (signal.SIGTERM, signal.SIGINT),
        (signal.SIGINT, signal.SIGTERM),
    ],
    ids=str,
)
def test_what_asks_again_does_not_interrupt(whole: Path, tmp_path: Path, numbers: tuple[signal.Signals, ...]) -> None:
    """As a manager does that signals all processes of a job, the agent of which hands it on."""

    def ask() -> None:
        for number in numbers:
            signal.raise_signal(number)

    with heard_by(signal.SIGHUP, signal.SIG_DFL), pytest.MonkeyPatch.context() as patch:
        at_call(patch, Trainer, "_update_generator", 7, ask)
        with suppress(KeyboardInterrupt):  # which would end the tests
            train(RECIPE, tmp_path, quiet=True)
    assert load(tmp_path).step == 7
    resume(tmp_path, RECIPE, quiet=True)
    assert differences(whole, tmp_path) == []


def test_the_second_ctrl_c_interrupts_at_once(whole: Path, tmp_path: Path) -> None:
    with pytest.MonkeyPatch.context() as patch:
        at_call(patch, Trainer, "_update_generator", 7, lambda: (interrupt(), interrupt()))
        with pytest.raises(KeyboardInterrupt):
            train(RECIPE, tmp_path, quiet=True)
    assert load(tmp_path).step == 6 and temporaries(tmp_path) == []
    resume(tmp_path, RECIPE, quiet=True)
    assert differences(whole, tmp_path) == []


class Noisy(LowRankGenerator):
    """A generator that draws from torch's global source, whenever it is called."""

    def forward(self, code: Tensor) -> Tensor:
        return super().forward(code + 0.3 * torch.randn_like(code))


class Dropping(ViewPredictor):
    """A view predictor that draws too, not in its fit alone."""

    def forward(self, y: Tensor) -> Tensor:
        return super().forward(dropout(y, 0.3))


def drawing(recipe: Recipe) -> Recipe:
    """The recipe with layers that draw in the generator and in the predictor."""
    noisy = recipe.replace(generator=partial(Noisy, size=16, channels=8, rank=4, code_size=8))
    return with_predicted(noisy, fit={"network": partial(Dropping, channels=4)})


@contextmanager
def within_the_second_fit(act: Callable[[], None]) -> Iterator[None]:
    """Run `act` after its fifth step; there is a checkpoint of the fourth."""
    calls, fit = 0, PredictorFit.run

    def stopped(*arguments: Any) -> Iterator[tuple[int, Tensor]]:
        nonlocal calls
        calls += 1
        for done, loss in fit(*arguments):
            if calls == 2 and done == 5:
                act()
            yield done, loss

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(predicted, "REPORT_EVERY", 1)
        patch.setattr(predicted, "SAVE_EVERY", 4)
        patch.setattr(PredictorFit, "run", stopped)
        yield


@pytest.mark.parametrize("act", [interrupt, die], ids=["stopped", "killed"])
@pytest.mark.parametrize(
    "recipe",
    [RECIPE, with_predicted(RECIPE, fit={"fresh": True}), drawing(RECIPE)],
    ids=["one predictor", "fresh ones", "layers that draw"],
)
def test_an_assignment_goes_on_where_it_was(tmp_path: Path, act: Callable[[], None], recipe: Recipe) -> None:
    """Of full size it takes minutes: its checkpoints have the predictor, its moments and the steps done."""
    recipe = with_predicted(recipe, fit={"steps": 7})
    whole = train(recipe, tmp_path / "whole", quiet=True).path
    run = tmp_path / "run"
    with within_the_second_fit(act), suppress(Killed):
        train(recipe, run, quiet=True)
    stored = checkpoint.load(checkpoint.newest(run / "checkpoints"), "panels/0/assignment/")
    assert stored["panels/0/assignment/fitting"] == 2
    assert stored["panels/0/assignment/fitted"] == (5 if act is interrupt else 4)
    assert resume(run, recipe, quiet=True).step == 8
    assert differences(whole, run) == []


def test_layers_that_draw_for_one_panel_do_not_depend_on_the_panel_before(tmp_path: Path) -> None:
    """Its round is done when the run goes on, and draws no more."""
    recipe = with_predicted(drawing(RECIPE), fit={"steps": 7})
    recipe = recipe.replace(panels=[*recipe.panels, replace(recipe.panels[0], weight=0.5)])
    whole = train(recipe, tmp_path / "whole", quiet=True).path
    with within_the_second_fit(die), pytest.raises(Killed):
        train(recipe, tmp_path / "run", quiet=True)
    resume(tmp_path / "run", recipe, quiet=True)
    assert differences(whole, tmp_path / "run") == []


@pytest.mark.parametrize("tries", [None, Tries(3, 0.25, least_steps=1)])
def test_layers_that_draw_go_on_where_they_were_right_before_a_round(
    tmp_path: Path, tries: Tries | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What they draw in a round depends neither on the step before it nor on the samples that a checkpoint shows."""
    monkeypatch.setattr(PredictedState, "merit", lambda _: torch.rand(()).item())  # of so few steps all are 0
    recipe = drawing(toy(steps=8, checkpoint_every=2, starts=(0.25, 0.5, 0.75))).replace(tries=tries)
    whole = train(recipe, tmp_path / "whole", quiet=True).path
    with pytest.MonkeyPatch.context() as patch:
        at_call(patch, PredictorFit, "run", 2, die)
        with pytest.raises(Killed):
            train(recipe, tmp_path / "run", quiet=True)
    resume(tmp_path / "run", recipe, quiet=True)
    assert differences(whole, tmp_path / "run") == []


HOLDER = """
import sys, time
from pathlib import Path
from unproject.training.lock import locked

with locked(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


@pytest.mark.skipif(lock.fcntl is None, reason="no locks on this system")
def test_a_run_is_trained_by_one_process_at_a_time(tmp_path: Path, forked: None) -> None:
    train(toy(steps=2), tmp_path, quiet=True)
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(tmp_path)], stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None and other.stdout.readline() == "held\n"
        with pytest.raises(UserError, match="another process is training this run"):
            resume(tmp_path, toy(steps=3), quiet=True)
        other.kill()  # however that process ends, the run is free again
    assert resume(tmp_path, toy(steps=3), quiet=True).step == 3


def test_a_new_budget_is_the_runs_own_from_then_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = tmp_path / "run"
    train(toy(steps=2, checkpoint_every=2), run, quiet=True)
    run_directory.write_json(run / run_directory.VERDICT, {"step": 2, "word": "good"})
    assert load(run, trust=True).complete and read_contents(run).complete
    with monkeypatch.context() as patch, suppress(Killed):
        at_call(patch, Trainer, "step", 1, die)
        resume(run, steps=8, trust=True, quiet=True)
    assert not load(run, trust=True).complete and not read_contents(run).complete
    resumed = resume(run, trust=True, quiet=True)  # no budget given: it goes on to the new one
    assert (resumed.step, resumed.complete, load(run, trust=True).complete) == (8, True, True)
    assert read_contents(run).recipe["arguments"]["steps"] == 8
    resume(run, minutes=1e9, steps=8, trust=True, quiet=True)
    assert read_contents(run).complete


def test_a_run_that_was_stopped_is_not_complete_when_it_is_opened(tmp_path: Path) -> None:
    train(toy(steps=2), tmp_path, quiet=True)
    recipe = tmp_path / "recipe.json"
    recipe.write_text(recipe.read_text().replace('"steps": 2', '"steps": 5'))
    assert not load(tmp_path, trust=True).complete and not read_contents(tmp_path).complete


CHANGED: dict[str, Recipe] = {
    "the data": with_panel(RECIPE, data=Collection(only_panel(RECIPE).collections[0].items.flip(0))),
    "seed": RECIPE.replace(seed=1),
    "batch": RECIPE.replace(batch=8),
    "generator_optimiser": RECIPE.replace(generator_optimiser=Adam(0.1)),
}


@pytest.mark.parametrize("settings", [{"starts": (0.25, 0.5)}, {"clusters": 2}], ids=str)
def test_another_assignment_is_refused(whole: Path, settings: dict[str, Any]) -> None:
    with pytest.raises(UserError, match=": panels differs"):
        resume(whole, toy(steps=8, **settings), quiet=True)


@pytest.mark.parametrize("field", CHANGED)
def test_another_recipe_is_refused_by_the_field(whole: Path, field: str) -> None:
    with pytest.raises(UserError, match=f": {field} differs?"):
        resume(whole, CHANGED[field], quiet=True)


def test_a_run_of_a_recipe_function_resumes_by_its_path_alone(whole: Path, tmp_path: Path) -> None:
    """With `trust`, since the toy is no part of the package."""
    with pytest.MonkeyPatch.context() as patch:
        at_call(patch, Trainer, "_update_generator", 6, die)
        with pytest.raises(Killed):
            train(RECIPE, tmp_path, quiet=True)
    with pytest.raises(UserError, match="code outside unproject; add --trust"):
        resume(tmp_path, quiet=True)
    assert resume(tmp_path, trust=True, quiet=True).step == 8
    assert differences(whole, tmp_path) == []


def test_a_recipe_that_was_changed_in_python_must_be_given(tmp_path: Path) -> None:
    recipe = with_panel(toy(steps=2), weight=2.0)
    train(recipe, tmp_path, quiet=True)
    with pytest.raises(UserError, match=r"built in Python; give it: unproject.resume\(path, recipe\)"):
        resume(tmp_path, trust=True, steps=4)
    assert resume(tmp_path, recipe, steps=4, quiet=True).step == 4


def test_options_that_were_changed_in_python_are_remembered(tmp_path: Path) -> None:
    train(toy(steps=3, views="known").replace(batch=2, steps=2, minutes=9.0), tmp_path, quiet=True)
    assert resume(tmp_path, trust=True, steps=3, quiet=True).step == 3


def test_a_learned_prior_goes_on_where_it_was(tmp_path: Path) -> None:
    """Its logits and their moments are part of the checkpoint."""
    recipe = toy(views="learned", steps=6, checkpoint_every=2)
    whole = train(recipe, tmp_path / "whole", quiet=True)
    with pytest.MonkeyPatch.context() as patch:
        at_call(patch, Trainer, "_update_generator", 6, die)
        with pytest.raises(Killed):
            train(recipe, tmp_path / "killed", quiet=True)
    resume(tmp_path / "killed", recipe, quiet=True)
    assert differences(whole.path, tmp_path / "killed") == []
    tensors = checkpoint.load(checkpoint.newest(whole.path / "checkpoints"))
    assert tensors["panels/0/assignment/logits"].abs().max() > 0


JOINTLY = jointly(RECIPE, weight=3.0)


@pytest.fixture(scope="module")
def whole_jointly(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose predictor is trained at every step, that nothing ever stopped."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trainer, "EVERY", 2)
        patch.setattr(Domain, "write_preview", lambda *_: None)
        return train(JOINTLY, tmp_path_factory.mktemp("jointly") / "run", quiet=True).path


@pytest.mark.parametrize("act", [interrupt, die], ids=["stopped", "killed"])
@pytest.mark.parametrize(
    "owner, name, number",
    [(JointlyPredictedState, "update", 5), (PredictorFit, "probabilities", 2), (Estimator, "assign", 2)],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_views_predicted_jointly_go_on_where_they_were(
    whole_jointly: Path, tmp_path: Path, act: Callable[[], None], owner: object, name: str, number: int
) -> None:
    """The predictor, its moments, and what it knows of fakes and of data are part of the checkpoint."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trainer, "EVERY", 2)
        at_call(patch, owner, name, number, act)
        with suppress(Killed):
            train(JOINTLY, tmp_path, quiet=True)
    assert load(tmp_path).step < 8
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trainer, "EVERY", 2)
        assert resume(tmp_path, JOINTLY, quiet=True).step == 8
    assert differences(whole_jointly, tmp_path) == []
    stored = checkpoint.load(checkpoint.newest(tmp_path / "checkpoints"), "panels/0/assignment/")
    assert stored["panels/0/assignment/of_data"] > 0 and stored["panels/0/assignment/of_fakes"] != 0
    assert stored["panels/0/assignment/round"] == 3
