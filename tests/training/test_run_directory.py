"""What is written beside a run."""

from __future__ import annotations

import platform
import shutil
import subprocess
from pathlib import Path

import pytest

from unproject.training.run_directory import _commit, environment


def test_the_processor_is_named_if_the_machine_tells_it() -> None:
    table = Path("/proc/cpuinfo")
    found = environment()["processor"]
    if not table.exists() or "model name" not in table.read_text():
        pytest.skip("this machine does not tell")
    assert f": {found}\n" in table.read_text() and found != platform.machine()


def test_the_commit_is_that_of_the_package_not_of_a_repository_around_it(tmp_path: Path) -> None:
    if not shutil.which("git"):
        pytest.skip("there is no git")
    git = ["git", "-C", str(tmp_path), "-c", "user.name=a", "-c", "user.email=a@b"]
    subprocess.run([*git, "init", "-q"], check=True)
    subprocess.run([*git, "commit", "-q", "--allow-empty", "-m", "x"], check=True)
    installed = tmp_path / ".venv" / "lib"
    installed.mkdir(parents=True)
    assert _commit(tmp_path) and _commit(installed) is None


def test_without_git_no_commit_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert _commit() is None
