"""What verbs set on the machine."""

from __future__ import annotations

import io
import subprocess
import sys

import pytest

from unproject.cli._machine import busy

FREED = """
import sys, torch
from unproject.cli._machine import return_memory

def resident():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * 4096 / 1e6

if sys.argv[1:] == ["returned"]:
    return_memory()
freed = torch.zeros(5_000_000)
del freed  # from now on glibc takes blocks of this size from its heap
before, kept, blocks = resident(), [], []
for _ in range(100):
    blocks.append(torch.zeros(500_000))
    kept.append(torch.zeros(1000))  # at the end of the heap
del blocks
print(resident() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="of glibc")
def test_freed_memory_is_returned() -> None:
    grown = {
        word: float(subprocess.run([sys.executable, "-c", FREED, word], capture_output=True, check=True).stdout)
        for word in ("returned", "kept")
    }
    assert grown["returned"] < 20 < 150 < grown["kept"]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_what_is_being_done_is_shown_on_a_terminal_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is printed meanwhile goes where it did."""
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with busy("reading the data"):
        print("by a recipe")
    assert "reading the data ..." in terminal.getvalue() and capsys.readouterr().out == "by a recipe\n"
    plain = io.StringIO()
    monkeypatch.setattr(sys, "stderr", plain)
    with busy("reading the data"):
        print("again")
    assert not plain.getvalue() and capsys.readouterr().out == "again\n"
