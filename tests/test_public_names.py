"""The front door: few names, all of them there, each documented where it lives."""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path

import pytest

import unproject
from unproject.cli import VERBS


def test_at_most_twenty_names() -> None:
    assert len(unproject.__all__) == len(set(unproject.__all__)) <= 20


@pytest.mark.parametrize("name", unproject.__all__)
def test_every_name_is_there(name: str) -> None:
    found = getattr(unproject, name)
    assert found.__doc__
    assert found is getattr(unproject, name)


def test_names_are_listed() -> None:
    assert set(unproject.__all__) <= set(dir(unproject))


def test_a_missing_name_is_pythons_own_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Sillhouette'"):
        unproject.Sillhouette  # noqa: B018


def test_type_checkers_see_the_same_names() -> None:
    """The table of homes and the imports under TYPE_CHECKING say the same."""
    text = Path(unproject.__file__).read_text(encoding="utf-8")
    imported = {
        alias.asname
        for block in ast.parse(text).body
        if isinstance(block, ast.If)
        for statement in block.body
        if isinstance(statement, ast.ImportFrom)
        for alias in statement.names
    }
    assert imported == set(unproject.__all__)


@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_has_its_module(verb: str) -> None:
    module = import_module(f"unproject.cli.{verb}")
    assert module.__doc__ and module.__doc__.startswith(f"`unproject {verb}")
    assert hasattr(module, "run") or hasattr(module, "parse")
