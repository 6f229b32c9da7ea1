"""The table of faults that tools/mutants.py plants: each can still be planted, and its tests are there."""

from __future__ import annotations

import ast
import importlib.util
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]


def load_table() -> ModuleType:
    """tools/mutants_table.py as a module; dataclasses want it among the loaded ones."""
    name = "mutants_table"
    spec = importlib.util.spec_from_file_location(name, ROOT / "tools" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


TABLE = load_table()
FILES = sorted({mutant.edits[0].file for mutant in TABLE.MUTANTS})


def test_there_are_sixty_at_least_of_different_names() -> None:
    names = [mutant.name for mutant in TABLE.MUTANTS]
    assert len(set(names)) == len(names) >= 60


def test_none_is_written_down_and_left_out() -> None:
    """A list of a name that another has takes its place without a word."""
    tree = ast.parse((ROOT / "tools" / "mutants_table.py").read_text(encoding="utf-8"))
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)]
    firsts = [call.args[0] for call in calls if call.func.id in ("mutant", "mutant_of_several")]  # type: ignore[attr-defined]
    written = {first.value for first in firsts if isinstance(first, ast.Constant)}
    assert len(written) > 500 and written <= {mutant.name for mutant in TABLE.MUTANTS}


@pytest.mark.parametrize("first", FILES)
def test_the_old_text_occurs_once_and_the_mutated_files_still_compile(first: str) -> None:
    for mutant in (mutant for mutant in TABLE.MUTANTS if mutant.edits[0].file == first):
        for file, text in TABLE.mutated(mutant, ROOT / TABLE.PACKAGE).items():
            assert text != file.read_text(encoding="utf-8"), mutant.name
            if file.suffix == ".py":
                compile(text, f"{file} with {mutant.name}", "exec")


@cache
def functions_of(file: str) -> set[str]:
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_the_named_tests_exist() -> None:
    for mutant in TABLE.MUTANTS:
        assert mutant.tests, mutant.name
        for test in mutant.tests:
            file, _, function = test.partition("::")
            assert (ROOT / file).exists() and (not function or function in functions_of(file)), test


@pytest.mark.parametrize("old, new, count", [("y", "x", 0), ("x", "y", 2), ("1", "1", 1)])
def test_a_fault_that_cannot_be_planted_is_an_error(tmp_path: Path, old: str, new: str, count: int) -> None:
    (tmp_path / "module.py").write_text("x = x + 1", encoding="utf-8")
    with pytest.raises(ValueError, match=f"occurs {count} times"):
        TABLE.mutated(TABLE.mutant("broken", "module.py", old, new), tmp_path)
