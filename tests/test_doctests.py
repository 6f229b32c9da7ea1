"""The examples in docstrings run, and every public class and function has one."""

from __future__ import annotations

import doctest
import inspect
import pkgutil
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import pytest

import unproject

FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def modules() -> list[str]:
    found = pkgutil.walk_packages(unproject.__path__, "unproject.")
    left_out = "__main__" if find_spec("triton") else ("__main__", "_triton")
    return [name for name in (module.name for module in found) if not name.endswith(left_out)]


def examples(module: ModuleType) -> list[doctest.DocTest]:
    return [test for test in doctest.DocTestFinder(exclude_empty=True).find(module) if test.examples]


@pytest.mark.parametrize("name", modules())
def test_the_examples_run(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    runner = doctest.DocTestRunner(verbose=False, optionflags=FLAGS)
    for test in examples(import_module(name)):
        report: list[str] = []
        runner.run(test, out=report.append)
        assert not runner.failures, "".join(report)


@pytest.mark.parametrize("name", unproject.__all__)
def test_every_public_name_has_an_example(name: str) -> None:
    part = getattr(unproject, name)
    if inspect.isclass(part) or inspect.isfunction(part):
        assert ">>>" in (part.__doc__ or "")
