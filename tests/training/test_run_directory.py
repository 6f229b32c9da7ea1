"""What is written beside a run."""

from __future__ import annotations

import platform
from pathlib import Path

import pytest

from unproject.training.run_directory import environment


def test_the_processor_is_named_if_the_machine_tells_it() -> None:
    table = Path("/proc/cpuinfo")
    found = environment()["processor"]
    if not table.exists() or "model name" not in table.read_text():
        pytest.skip("this machine does not tell")
    assert f": {found}\n" in table.read_text() and found != platform.machine()
