"""Cores: those that are open to a process, and no more than its control groups give it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from unproject import _cores
from unproject._cores import cores

V1 = "9:cpuset:/\n3:cpu,cpuacct:/job\n1:name=systemd:/job\n0::/\n"


@pytest.fixture(autouse=True)
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Control groups of a machine of 64 cores, whose processes are in none."""
    monkeypatch.setattr(_cores, "GROUPS", tmp_path / "cgroup")
    monkeypatch.setattr(_cores, "OWN", tmp_path / "own")
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: set(range(64)), raising=False)
    return tmp_path


def write(file: Path, text: str) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)


@pytest.mark.parametrize(
    "own, files, found",
    [
        ("0::/\n", {"cpu.max": "200000 100000\n"}, 2),
        ("0::/\n", {"cpu.max": "max 100000\n"}, 64),
        ("0::/\n", {"cpu.max": "50000 100000\n"}, 1),
        ("0::/\n", {"cpu.max": "1999999 1000000\n"}, 1),
        ("0::/\n", {"cpu.max": "90000000 100000\n"}, 64),
        ("0::/a/b\n", {"a/cpu.max": "300000 100000\n", "a/b/cpu.max": "800000 100000\n"}, 3),
        ("0::/host/docker/5f\n", {"cpu.max": "400000 100000\n"}, 4),
        ("0::/../outside\n", {"cpu.max": "400000 100000\n"}, 4),
        (V1, {"cpu/job/cpu.cfs_quota_us": "250000\n", "cpu/job/cpu.cfs_period_us": "50000\n"}, 5),
        (V1, {"cpu/cpu.cfs_quota_us": "250000\n", "cpu/cpu.cfs_period_us": "50000\n"}, 5),
        (V1, {"cpu/job/cpu.cfs_quota_us": "-1\n", "cpu/job/cpu.cfs_period_us": "50000\n"}, 64),
        (V1, {"cpuset/cpu.cfs_quota_us": "100000\n", "cpuset/cpu.cfs_period_us": "100000\n"}, 64),
        ("0::/\n", {"cpu.max": "200000 0\n"}, 64),
        ("0::/\n", {"cpu.max": "a b c\n"}, 64),
        ("nothing of the kind\n", {"cpu.max": "200000 100000\n"}, 64),
    ],
)
def test_no_more_than_control_groups_give(groups: Path, own: str, files: dict[str, str], found: int) -> None:
    write(groups / "own", own)
    for name, text in files.items():
        write(groups / "cgroup" / name, text)
    assert cores() == found


def test_a_system_without_them_gives_what_is_open() -> None:
    assert cores() == 64


def test_systems_that_do_not_say_what_is_open(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 6)
    assert cores() == 6
    monkeypatch.setattr(os, "cpu_count", lambda: None)
    assert cores() == 1
