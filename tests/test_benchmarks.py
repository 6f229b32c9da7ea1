"""Benchmarks import, explain themselves, and their smallest parts run."""

from __future__ import annotations

import argparse
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

from unproject.training.recorder import Recorder

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"
NAMES = sorted(path.stem for path in BENCHMARKS.glob("*.py") if path.stem != "mitsuba_speed")
"""All but a script that another one starts as a process of its own."""


@pytest.fixture
def named(monkeypatch: pytest.MonkeyPatch) -> object:
    """Import a benchmark by name, as `python benchmarks/NAME.py` finds its neighbours."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 4)
    before = set(sys.modules)
    yield import_module
    for name in set(NAMES) & (set(sys.modules) - before):
        del sys.modules[name]


@pytest.mark.parametrize(
    "name", [name for name in NAMES if name != "mitsuba_speed"]
)  # a script for a process of its own
def test_a_benchmark_imports_and_explains_itself(
    name: str, named: object, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    module: ModuleType = named(name)  # type: ignore[operator]
    assert module.__doc__
    if hasattr(module, "main"):
        monkeypatch.setattr(sys, "argv", [f"{name}.py", "--help"])
        with pytest.raises(SystemExit) as end:
            module.main()
        assert end.value.code == 0 and "usage:" in capsys.readouterr().out


def test_heads_take_a_step(named: object, tmp_path: Path) -> None:
    with Recorder(tmp_path, quiet=True) as recorder:
        trainer = named("heads").trainer(4, tmp_path, recorder)  # type: ignore[operator]
        trainer.step()
    assert trainer.state.counters.step == 1


def test_sooner_trains_until_a_target(named: object, monkeypatch: pytest.MonkeyPatch) -> None:
    sooner = named("sooner")  # type: ignore[operator]
    monkeypatch.setattr(sooner, "CHECK", 0.0)
    recipe = sooner.shapes(views="known", steps=10, batch=4, channels=8, rank=2)
    assert sooner.seconds_to(10.0, recipe, 60.0)[1]


def test_a_material_step_is_timed(named: object) -> None:
    clock = named("material_step").profile(("flash",), argparse.Namespace(size=16, steps=2))  # type: ignore[operator]
    assert {"step", "generator", "projection", "discriminators' update", "rendering"} <= set(clock)
    assert all(len(values) == 2 for values in clock.values())


def test_photographs_of_exchanged_maps_are_compared(named: object, monkeypatch: pytest.MonkeyPatch) -> None:
    told_apart = named("told_apart")  # type: ignore[operator]
    monkeypatch.setattr(told_apart, "SIZE", 16)
    found = told_apart.told_apart("wood", "flash", None, 8, told_apart.exchanges)
    assert set(found) == {"none", "diffuse", "specular", "roughness", "normal", "all"}
