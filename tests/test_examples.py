"""Every example: short, lawful, and it trains, by the commands that its first lines name."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from unproject.cli import main
from unproject.training import load

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example(example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = example.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 40
    commands = re.findall(r"^unproject (.+)$", text, re.MULTILINE)
    assert [command.split()[0] for command in commands] == ["check", "train"]
    monkeypatch.chdir(ROOT)
    for command in commands:
        command = re.sub(r"--minutes \d+", "--steps 2 --quiet --threads 1", command)
        command = re.sub(r"--out \S+", f"--out {tmp_path / 'run'}", command)
        assert main(shlex.split(command)) == 0
    assert load(tmp_path / "run").step == 2
