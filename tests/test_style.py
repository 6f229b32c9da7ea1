"""Small functions, small modules, few parameters, and no trace of the machine the code was written on."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("src", "tests", "benchmarks", "docs", "examples")
MODULES = sorted((ROOT / "src").rglob("*.py"))
LONGEST_FUNCTION, LONGEST_MODULE, MOST_PARAMETERS = 50, 310, 9

# Written in two pieces so that this file does not hold what it looks for.
MACHINE_PATH = re.compile("|".join(["/wor" + "k/", "/ho" + "me/", "/ro" + "ot/", "/op" + "t/", "/Us" + "ers/"]))

Function = ast.FunctionDef | ast.AsyncFunctionDef


def functions(text: str) -> Iterator[Function]:
    return (node for node in ast.walk(ast.parse(text)) if isinstance(node, Function))


def length(function: Function) -> int:
    """Lines from `def` to the end, less the docstring."""
    lines = (function.end_lineno or function.lineno) - function.lineno + 1
    first = function.body[0]
    if ast.get_docstring(function) is not None:
        lines -= (first.end_lineno or first.lineno) - first.lineno + 1
    return lines


def parameters(function: Function) -> int:
    """How many arguments a caller can give, `self` and `cls` left out.

    A kernel in Triton is let off, which takes what it needs one by one; and
    a function that returns a `Recipe`: its parameters are the experiment's configuration, each a flag
    of `unproject train`, and hiding them in an object would only hide the flags. So are the keyword-only ones of a
    verb's `run(argument, /, *, ...)`.
    """
    if isinstance(function.returns, ast.Name) and function.returns.id == "Recipe":
        return 0
    if any(ast.unparse(decorator) == "triton.jit" for decorator in function.decorator_list):
        return 0
    verb = function.name == "run" and function.args.posonlyargs and not function.args.args
    flags = [] if verb else function.args.kwonlyargs
    named = [a.arg for a in (*function.args.posonlyargs, *function.args.args, *flags)]
    return len([name for name in named if name not in ("self", "cls")])


def faults(text: str) -> list[str]:
    found = [f"{f.name} has {length(f)} lines" for f in functions(text) if length(f) > LONGEST_FUNCTION]
    found += [f"{f.name} takes {parameters(f)} parameters" for f in functions(text) if parameters(f) > MOST_PARAMETERS]
    lines = len(text.splitlines())
    return found + ([f"the module has {lines} lines"] if lines > LONGEST_MODULE else [])


@pytest.mark.parametrize("path", MODULES, ids=lambda p: p.relative_to(ROOT / "src").as_posix())
def test_functions_and_modules_are_small(path: Path) -> None:
    assert faults(path.read_text(encoding="utf-8")) == []


def test_the_median_function_is_short() -> None:
    lengths = sorted(length(f) for path in MODULES for f in functions(path.read_text(encoding="utf-8")))
    assert median(lengths) <= 9
    assert lengths[int(0.9 * len(lengths))] <= 36


@pytest.mark.parametrize("path", MODULES, ids=lambda p: p.relative_to(ROOT / "src").as_posix())
def test_every_module_says_its_concept(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert not text.strip() or ast.get_docstring(ast.parse(text))


def written() -> Iterator[Path]:
    """Every file that a person wrote: what a clone holds, less pictures and data."""
    kinds = {".py", ".md", ".toml", ".txt", ".json", ".rst", ".yml", ""}
    for folder in FOLDERS:
        for path in (ROOT / folder).rglob("*"):
            hidden = {"node_modules", "__pycache__", "_build"} & set(path.parts) or ".egg-info" in str(path)
            if path.is_file() and path.suffix in kinds and not hidden:
                yield path
    yield from (path for path in ROOT.iterdir() if path.is_file() and path.suffix in kinds and path.name != ".git")


def test_no_path_of_a_machine() -> None:
    found = [p.relative_to(ROOT).as_posix() for p in written() if MACHINE_PATH.search(p.read_text(errors="ignore"))]
    assert found == []


def test_the_rules_catch_what_breaks_them() -> None:
    many = ", ".join(f"a{i}" for i in range(MOST_PARAMETERS + 1))
    body = "\n".join(["    x = 1"] * LONGEST_FUNCTION)
    assert faults(f"def f({many}): pass") == [f"f takes {MOST_PARAMETERS + 1} parameters"]
    assert faults(f"def f():\n{body}") == [f"f has {LONGEST_FUNCTION + 1} lines"]
    assert faults("\n" * (LONGEST_MODULE + 1)) == [f"the module has {LONGEST_MODULE + 1} lines"]
    assert faults('def f():\n    """' + "long\n" * 100 + '    """') == []
    assert MACHINE_PATH.search("see /wor" + "k/data")
