"""Threads: one a core that nobody else keeps busy, and as many as before where a run goes on."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import torch

from unproject import _cores, cli
from unproject.cli import _threads
from unproject.cli._threads import Clocks, begin_to_measure, use_threads
from unproject.training.run_directory import threads_of

CORES = 8
HZ = os.sysconf("SC_CLK_TCK")
Machine = Callable[..., None]
"""(busy, own): how many cores others keep busy meanwhile, and how many this process."""

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other systems tell it otherwise")


@pytest.fixture(autouse=True)
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Machine]:
    """A machine of eight cores, of which cores 4 to 11 of twelve are open to this process, for a second."""
    for name in _threads.GIVEN_BY:
        monkeypatch.delenv(name, raising=False)
    before = torch.get_num_threads()
    torch.set_num_threads(CORES)
    clock = [100.0, 7.0]
    monkeypatch.setattr(_threads, "STATISTICS", tmp_path / "stat")
    monkeypatch.setattr(_cores, "OWN", tmp_path / "in no control group")
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(4, 4 + CORES)))
    monkeypatch.setattr(time, "monotonic", lambda: clock[0])
    monkeypatch.setattr(
        os, "times", lambda: os.times_result((clock[1] / 2, clock[1] / 4, clock[1] / 8, clock[1] / 8, 0))
    )
    write(tmp_path / "stat", idle=0)
    begin_to_measure()

    def second(busy: float, own: float = 1.0) -> None:
        clock[0] += 1
        clock[1] += own
        write(tmp_path / "stat", idle=CORES - busy - own)

    yield second
    _threads._began.clear()
    torch.set_num_threads(before)


def write(file: Path, idle: float) -> None:
    """Cores that are open were idle for so long in all, half of it waiting for a disk; the others all the second."""
    each = round(idle * HZ / CORES / 2)
    open_to = [f"cpu{i} 5 6 7 {each} {each} 8 9 10 0 0" for i in range(4, 12)]
    others = [f"cpu{i} 5 6 7 {HZ if idle else 0} {HZ} 8 9 10 0 0" for i in range(4)]
    file.write_text("\n".join(["cpu 1 2 3 4 5 6 7 8 0 0", *others, *open_to, "intr 1 2 3 4 5 6", "ctxt 9 9 9 9 9 9"]))


@pytest.mark.parametrize("busy, own, threads", [(0, 1, 8), (0, 0.1, 8), (1, 1, 7), (0.4, 1, 8), (2.6, 3, 5), (8, 0, 1)])
def test_as_many_threads_as_cores_that_nobody_else_uses(machine: Machine, busy: float, own: float, threads: int):
    machine(busy, own)
    use_threads(None)
    assert torch.get_num_threads() == threads


def test_threads_that_are_given_are_used_whatever_the_load(machine: Machine, capsys: pytest.CaptureFixture[str]):
    machine(7)
    use_threads(6)
    assert torch.get_num_threads() == 6
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("name", ["OMP_NUM_THREADS", "MKL_NUM_THREADS"])
def test_the_environment_chooses(machine: Machine, name: str, monkeypatch: pytest.MonkeyPatch):
    machine(7)
    monkeypatch.setenv(name, "8")
    use_threads(None, before=3)
    assert torch.get_num_threads() == CORES


def test_a_quiet_machine_goes_without_a_word(machine: Machine, capsys: pytest.CaptureFixture[str]):
    machine(0)
    use_threads(None)
    assert capsys.readouterr().err == ""


def test_it_is_said_that_cores_are_busy(machine: Machine, capsys: pytest.CaptureFixture[str]):
    machine(6.7)
    use_threads(None)
    line = "7 of 8 cores are kept busy by other programs; computing with 1 thread (--threads changes that)\n"
    assert capsys.readouterr().err == line


def test_a_container_computes_with_the_cores_it_is_given(machine: Machine, tmp_path: Path, monkeypatch, capsys):
    """It sees all those of its host, which may be idle."""
    (tmp_path / "own").write_text("0::/\n")
    (tmp_path / "cpu.max").write_text("300000 100000\n")
    monkeypatch.setattr(_cores, "OWN", tmp_path / "own")
    monkeypatch.setattr(_cores, "GROUPS", tmp_path)
    machine(1)
    use_threads(None)
    assert torch.get_num_threads() == 3 and capsys.readouterr().err == ""


@pytest.mark.parametrize("before, busy, used", [(3, 0, 3), (3, 6, 3), (8, 6, 8), (64, 0, 8)])
def test_a_run_goes_on_with_the_threads_it_began_with(machine: Machine, before: int, busy: float, used: int):
    machine(busy)
    use_threads(None, before=before)
    assert torch.get_num_threads() == used


def test_it_is_said_that_a_run_goes_on_with_others_than_there_are_free(machine, capsys: pytest.CaptureFixture[str]):
    machine(6)
    use_threads(None, before=8)
    found = capsys.readouterr().err
    assert found.startswith("6 of 8 cores are kept busy by other programs; computing with 8 threads as before, ")
    assert "and 2 would give other numbers" in found


def test_cores_that_cannot_be_told_are_all_used(machine: Machine, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    begin_to_measure()
    machine(7)
    use_threads(None)
    assert torch.get_num_threads() == CORES


def test_a_system_without_statistics_is_no_mistake(machine: Machine, tmp_path: Path):
    (tmp_path / "stat").unlink()
    begin_to_measure()
    use_threads(None)
    assert torch.get_num_threads() == CORES


def test_too_short_a_measurement_waits(machine: Machine, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(time, "sleep", lambda seconds: machine(5))
    use_threads(None)
    assert torch.get_num_threads() == 3


def test_this_machine_tells(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.undo()
    first = Clocks.now()
    time.sleep(0.05)
    assert 0 <= first.free_cores(Clocks.now()) <= (os.cpu_count() or 1) + 1.5


@pytest.mark.parametrize("verb", ["train", "demo", "evaluate", "render", "fit", "studio", "report"])
def test_every_verb_that_computes_says_so(verb: str, capsys: pytest.CaptureFixture[str]):
    cli.main([verb, *(["shapes"] if verb == "train" else []), "--help"])
    assert "one a core that nobody else keeps busy" in " ".join(capsys.readouterr().out.split())


@pytest.mark.parametrize(
    "text, threads", [('{"threads": 3}', 3), ('{"threads": 0}', None), ('{"threads": "3"}', None), ("[]", None)]
)
def test_the_threads_a_run_began_with(tmp_path: Path, text: str, threads: int | None):
    assert threads_of(tmp_path) is None
    (tmp_path / "environment.json").write_text(text)
    assert threads_of(tmp_path) == threads


def test_resume_goes_on_with_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "environment.json").write_text('{"threads": 3}')
    asked: list[object] = []
    monkeypatch.setattr("unproject.cli.resume.use_threads", lambda *given, **named: asked.append((given, named)))
    assert cli.main(["resume", str(tmp_path)]) == 2
    assert asked == [((None,), {"before": 3})]
