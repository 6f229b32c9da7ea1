"""`module:name` and `file.py:name`: found, or one sentence that says what is missing."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from unproject._objects import find_object
from unproject._types import UserError


@pytest.fixture(autouse=True)
def clean_path(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.chdir(tmp_path)


def written(name: str, text: str) -> None:
    Path(name).parent.mkdir(exist_ok=True)
    Path(name).write_text(text, encoding="utf-8")


def test_a_module_that_is_installed() -> None:
    assert find_object("unproject._types:UserError") is UserError


def test_a_dotted_name() -> None:
    assert find_object("pathlib:Path.home") == Path.home


def test_a_module_in_the_current_folder() -> None:
    written("module_of_this_test.py", "depth = 3")
    assert find_object("module_of_this_test:depth") == 3


def test_a_file_and_its_neighbour() -> None:
    written("parts/neighbour_of_this_test.py", "depth = 4")
    written("parts/look.py", "from neighbour_of_this_test import depth")
    assert find_object("parts/look.py:depth") == 4


def test_a_dataclass_in_a_file() -> None:
    text = (
        "from __future__ import annotations\nfrom dataclasses import dataclass\n@dataclass\nclass Look:\n    a: int = 1"
    )
    written("shape.py", text)
    assert find_object("shape.py:Look")().a == 1


@pytest.mark.parametrize(
    "where, said",
    [
        ("look", "write module:name"),
        ("look:", "write module:name"),
        (":look", "write module:name"),
        ("./shape:look", "write module:name or path/to/file.py:name"),
        ("nowhere.py:look", "nowhere.py: no such file"),
        ("no_such_module:look", "there is no module 'no_such_module'"),
        ("unproject.nothing:look", "there is no module 'unproject.nothing'"),
        ("unproject._types:UserErorr", "Perhaps you meant 'UserError'"),
        ("broken.py:look", "importing broken.py raised SyntaxError"),
        ("failing.py:look", "importing failing.py raised ZeroDivisionError"),
        ("lacking.py:look", "importing lacking.py raised ModuleNotFoundError"),
        ("lacking:look", "importing lacking raised ModuleNotFoundError"),
    ],
)
def test_mistakes(where: str, said: str) -> None:
    written("broken.py", "def (")
    written("failing.py", "1 / 0")
    written("lacking.py", "import a_module_that_nobody_has")
    with pytest.raises(UserError) as caught:
        find_object(where)
    assert said in str(caught.value)
