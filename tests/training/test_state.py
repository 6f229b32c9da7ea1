"""State: everything a step changes goes into a checkpoint and comes back from it."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor
from toy import toy

from unproject._types import UserError
from unproject.training import checkpoint, train
from unproject.training.recorder import Recorder
from unproject.training.state import State

CPU = torch.device("cpu")


def bits(a: dict[str, Tensor], b: dict[str, Tensor]) -> bool:
    return set(a) == set(b) and all(torch.equal(a[k], b[k]) for k in a)


def test_a_state_comes_back_from_its_tensors(tmp_path: Path) -> None:
    recipe = toy(steps=6)
    run = train(recipe, tmp_path / "run", quiet=True).path
    stored = checkpoint.load(checkpoint.newest(run / "checkpoints"))
    state = State(recipe, CPU)
    assert not bits(state.tensors(), stored)
    state.load(stored)
    assert bits(state.tensors(), stored)
    assert state.counters.step == 6 and isinstance(state.counters.step, int)
    assert state.panels[0].assignment.round == 3


def test_a_checkpoint_holds_every_kind_of_thing_a_step_changes(tmp_path: Path) -> None:
    run = train(toy(steps=6), tmp_path / "run", quiet=True).path
    names = set(checkpoint.load(checkpoint.newest(run / "checkpoints")))
    assert {name.split("/")[0] for name in names} == {
        "generator", "average", "discriminators", "generator_optimiser", "discriminator_optimiser", "panels",
        "counters",
    }  # fmt: skip


def test_tensors_are_a_copy() -> None:
    state = State(toy(steps=1), CPU)
    before = state.tensors()
    with torch.no_grad():
        for p in state.generator.parameters():
            p.add_(1)
    assert bits(before, State(toy(steps=1), CPU).tensors())


@pytest.mark.parametrize("other", [toy(steps=1, views="known"), toy(steps=1, clusters=2), toy(steps=1, views="direct")])
def test_another_recipes_tensors_are_refused(other: object) -> None:
    with pytest.raises(UserError, match="another run|has no"):
        State(toy(steps=1), CPU).load(State(other, CPU).tensors())  # type: ignore[arg-type]


def test_weights_depend_on_the_seed_alone() -> None:
    torch.manual_seed(1)
    a = State(toy(steps=1, seed=5), CPU).tensors()
    torch.manual_seed(2)
    assert bits(a, State(toy(steps=1, seed=5), CPU).tensors())
    assert not bits(a, State(toy(steps=1, seed=6), CPU).tensors())


def test_averaged_weights_have_the_half_life_that_is_asked_for() -> None:
    state = State(toy(steps=1), CPU)
    state.counters.step = 10_000
    start = state.average.bias.clone()
    with torch.no_grad():
        state.generator.bias.add_(8)
    for _ in range(30):
        state.update_average(10)
    assert float(state.average.bias - start) == pytest.approx(8 * (1 - 0.5**3), rel=1e-4)


def test_without_an_average_the_weights_are_copied() -> None:
    state = State(toy(steps=1), CPU)
    state.counters.step = 10_000
    with torch.no_grad():
        state.generator.bias.add_(8)
    state.update_average(0)
    assert torch.equal(state.average.bias, state.generator.bias)


def test_early_on_the_average_follows_quickly() -> None:
    state = State(toy(steps=1), CPU)
    state.counters.step = 1
    with torch.no_grad():
        state.generator.bias.add_(8)
    before = float(state.average.bias)
    state.update_average(300)
    assert float(state.average.bias) - before == pytest.approx(4)


def test_weights_that_began_anew_are_followed_as_quickly() -> None:
    """Of the first, random ones nothing is left soon after, as at the start of the run."""
    state = State(toy(steps=1), CPU)
    state.counters.step = 1000
    state.restart()
    start = state.average.bias.clone()
    with torch.no_grad():
        state.generator.bias.add_(8)
    for _ in range(100):
        state.counters.step += 1
        state.update_average(300)
    assert float(state.average.bias - start) > 0.999 * 8


# Files of checkpoints and logs


def test_the_newest_two_checkpoints_are_kept(tmp_path: Path) -> None:
    for step in (1, 2, 10, 200):
        checkpoint.save(tmp_path, step, {"a": torch.tensor([float(step)])})
    assert [p.name for p in checkpoint.list_checkpoints(tmp_path)] == [
        "step-000000010.safetensors",
        "step-000000200.safetensors",
    ]
    assert checkpoint.load(checkpoint.newest(tmp_path))["a"].tolist() == [200.0]


def test_a_prefix_loads_a_part(tmp_path: Path) -> None:
    path = checkpoint.save(tmp_path, 1, {"a/x": torch.zeros(1), "b/x": torch.ones(1)})
    assert set(checkpoint.load(path, "b/")) == {"b/x"}


def test_what_was_loaded_outlives_its_file(tmp_path: Path) -> None:
    path = checkpoint.save(tmp_path, 1, {"a": torch.arange(100_000)})
    loaded = checkpoint.load(path)["a"]
    path.write_bytes(b"")
    assert torch.equal(loaded, torch.arange(100_000))


def test_a_log_is_cut_to_the_lines_a_checkpoint_knows(tmp_path: Path) -> None:
    with Recorder(tmp_path, quiet=True) as recorder:
        for step in (2, 4, 4, 6):
            recorder.write(step, 0.0)
    assert recorder.lines == 4
    with Recorder(tmp_path, 2, quiet=True) as recorder:
        recorder.write(8, 0.5, loss=1.0)
    lines = (tmp_path / "stats.jsonl").read_text().splitlines()
    assert lines == [
        '{"step": 2, "seconds": 0.0}', '{"step": 4, "seconds": 0.0}', '{"step": 8, "seconds": 0.5, "loss": 1.0}'
    ]  # fmt: skip


def test_only_the_leading_process_writes_or_speaks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with Recorder(tmp_path, leads=False) as recorder:
        recorder.write(1, 0.0)
        recorder.say("hello")
        recorder.subtask("predictor", 3)(3, 0.1)
    assert list(tmp_path.iterdir()) == [] and capsys.readouterr().err == ""


def test_loading_draws_from_no_source_of_the_users() -> None:
    state = State(toy(steps=2), torch.device("cpu"))
    tensors = state.tensors()
    torch.manual_seed(0)
    before = torch.get_rng_state()
    state.load(tensors)
    assert torch.equal(torch.get_rng_state(), before)
