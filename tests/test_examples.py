"""Every example: short, lawful, and it trains, by the commands that its first lines name."""

from __future__ import annotations

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from unproject._objects import find_object
from unproject._types import UserError
from unproject.assignment import Panel
from unproject.cli import main
from unproject.projections.observation import Observation
from unproject.training import load
from unproject.training.state import State

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))


@pytest.fixture(autouse=True)
def in_the_repository(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example(example: Path, tmp_path: Path) -> None:
    text = example.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 40
    commands = re.findall(r"^unproject (.+)$", text, re.MULTILINE)
    assert [command.split()[0] for command in commands] == ["check", "train"]
    for command in commands:
        command = re.sub(r"--minutes \d+", "--steps 2 --quiet --threads 1", command)
        command = re.sub(r"--out \S+", f"--out {tmp_path / 'run'}", command)
        assert main(shlex.split(command)) == 0
    assert load(tmp_path / "run", trust=True).step == 2


def test_the_scanner_has_one_discriminator_with_a_head_a_position() -> None:
    state = State(find_object("examples/fan_beam.py:scanner")(), torch.device("cpu"))
    (panel,) = state.panels
    assert len(state.discriminators) == 1 and len(panel.panel.observations) == 12
    assert panel.panel.assignment.heads(panel.panel) == 12 and panel.assignment.heads.unique().tolist() == [*range(12)]
    assert len(state.discriminators[0].own.weight) == 12  # pyright: ignore


def test_a_projection_for_each_position_is_refused() -> None:
    scanner = find_object("examples/fan_beam.py:scanner")()
    (panel,) = scanner.panels
    own = [Observation(o.name, type(o.projection)(), o.prior) for o in panel.observations]
    with pytest.raises(UserError, match="must share one projection; make it once and give it to each"):
        Panel(own, panel.data)


def test_the_verbs_know_a_domain_of_ones_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, samples = tmp_path / "run", tmp_path / "samples.npz"
    train = ["train", "examples/signals.py:signals", "--steps", "3", "--batch", "8", "--quiet", "--out", str(run)]
    assert main(train) == 0
    command = shlex.split(capsys.readouterr().out.partition("next: unproject ")[2])
    assert command[-1] == "--trust" and main(command) == 0
    with Image.open(run / "samples.png") as picture:
        assert 2 * 64 < picture.width < 3 * 64 and 8 * 8 < picture.height < 9 * 9  # two columns of eight signals
    assert main(["sample", str(run), "--n", "5", "--trust", "--out", str(samples)]) == 0
    with np.load(samples) as arrays:
        assert arrays.files == ["sample"] and arrays["sample"].shape == (5, 64)
    capsys.readouterr()
    assert main(["evaluate", str(run), "--n", "6", "--trust"]) == 0
    assert "diversity" in capsys.readouterr().out
    assert main(["evaluate", str(run), "--n", "6"]) == 2 and "--trust" in capsys.readouterr().err
    opened = load(run, trust=True)
    found = opened.evaluate(opened.sample(6, seed=1), n=6)
    assert (
        found["spectrum"].value > 0 and opened.domain.scores(opened.sample(6), opened.sample(6))["spectrum"].value == 0
    )
    assert main(["export", str(run), "--to", "glb", "--trust", "--out", str(tmp_path / "x")]) == 2
    assert "choose from npz, png" in capsys.readouterr().err


def test_an_assignment_of_ones_own_decides_views_and_heads(tmp_path: Path) -> None:
    recipe = find_object("examples/own_assignment.py:halves")(seed=1)
    state = State(recipe, torch.device("cpu"))
    (panel,) = state.panels
    assert panel.assignment.heads.unique().tolist() == [0, 1]
    front = panel.assignment.views[panel.assignment.heads == 0].unique().tolist()
    assert front == [0, 1, 6, 7]  # of eight views the first looks at the front
    seen: list[int] = []
    project = Panel.project

    def watched(self: Panel, x: torch.Tensor, views: torch.Tensor, *of: Any) -> torch.Tensor:
        seen.extend(views.tolist())
        return project(self, x, views, *of)

    rows = (panel.assignment.heads == 0).nonzero()[:64, 0]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Panel, "project", watched)
        panel.assignment.project(torch.zeros(64, 32, 32, 32), rows, torch.Generator().manual_seed(0))
    assert set(seen) == {0, 1, 6, 7}
