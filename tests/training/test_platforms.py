"""What other systems lack, taken away here: docs/security.md has the list."""

from __future__ import annotations

import errno
import fcntl
import os
import signal
import threading
from pathlib import Path
from typing import Any

import pytest
import torch
from toy import toy

from unproject import _files
from unproject._types import UserError
from unproject.ops import _builds, _native
from unproject.training import environment, lock, resume, train
from unproject.training.distribution import Distribution
from unproject.training.memory import _left_to_container, available_memory
from unproject.training.signals import stop_request


def test_without_locks_a_run_is_trained_and_resumed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lock, "fcntl", None)
    train(toy(steps=1), tmp_path, quiet=True)
    assert resume(tmp_path, toy(steps=2), quiet=True).step == 2


def test_a_system_that_flushes_only_what_is_open_for_writing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows, where folders cannot be flushed at all."""
    flushed = []

    def fsync(descriptor: int) -> None:
        if fcntl.fcntl(descriptor, fcntl.F_GETFL) & os.O_ACCMODE == os.O_RDONLY:
            raise OSError(errno.EBADF, "Bad file descriptor")
        flushed.append(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    with _files.atomic_path(tmp_path / "x") as temporary:
        temporary.write_text("whole")
    assert (tmp_path / "x").read_text() == "whole" and len(flushed) == 1


def test_without_proc_memory_is_not_known_and_the_processor_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    there = Path.exists
    monkeypatch.setattr(Path, "exists", lambda self: not str(self).startswith("/proc") and there(self))
    assert available_memory(torch.device("cpu")) is None
    assert environment._processor()
    monkeypatch.setattr(Path, "read_text", lambda *words, **more: (_ for _ in ()).throw(FileNotFoundError()))
    assert _native._processor()


def test_wheels_of_other_systems_have_no_kernels(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for system in ("Darwin", "Windows"):
        monkeypatch.setattr(_builds.platform, "system", lambda name=system: name)
        assert not _builds.can_compile() and _builds.compile_all(Path(_builds.__file__).parent, tmp_path) == []


def test_in_a_thread_where_no_signal_can_be_caught_nothing_asks_to_stop() -> None:
    found: list[Any] = []

    def within() -> None:
        with stop_request() as asked:
            found.append(asked())

    thread = threading.Thread(target=within)
    before = signal.getsignal(signal.SIGTERM)
    thread.start()
    thread.join()
    assert found == [False] and signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize(
    ("limit", "used", "limits"),
    [
        ("memory.max", "memory.current", {"1000": [700], "max": []}),
        ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes", {"1000": [700]}),
    ],
)
def test_a_containers_limit_counts_without_what_is_cached(
    tmp_path: Path, limit: str, used: str, limits: dict[str, list[int]]
) -> None:
    assert _left_to_container(tmp_path) == []
    (tmp_path / limit).parent.mkdir(exist_ok=True)
    (tmp_path / limit).with_name("memory.stat").write_text("anon 400\ninactive_file 200\ntotal_inactive_file 200\n")
    (tmp_path / used).write_text("500\n")
    for most, left in limits.items():
        (tmp_path / limit).write_text(f"{most}\n")
        assert _left_to_container(tmp_path) == left


def test_processes_of_one_machine_share_its_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOCAL_WORLD_SIZE", "1000")
    shared = available_memory(torch.device("cpu"))
    monkeypatch.delenv("LOCAL_WORLD_SIZE")
    alone = available_memory(torch.device("cpu"))
    assert shared is None or alone is None or shared < alone / 500


def test_processes_that_nobody_started_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some clusters set the number of processes for each one."""
    for name in ("RANK", "MASTER_ADDR", "MASTER_PORT"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("WORLD_SIZE", "2")
    with pytest.raises(UserError, match="WORLD_SIZE=2 is set, but not RANK, MASTER_ADDR, MASTER_PORT"):
        Distribution("cpu")
    monkeypatch.setenv("WORLD_SIZE", "two")
    with pytest.raises(UserError, match="WORLD_SIZE='two': is no number of processes"):
        Distribution("cpu")
