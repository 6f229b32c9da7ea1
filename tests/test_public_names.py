"""Public names: each is there, in one list, and documented where it lives."""

from __future__ import annotations

import ast
from importlib import import_module
from pathlib import Path

import pytest

import unproject
from unproject.cli import VERBS

PACKAGES = [name for name in unproject.__all__ if name.islower() and hasattr(getattr(unproject, name), "__all__")]


def test_no_name_is_listed_twice() -> None:
    assert len(unproject.__all__) == len(set(unproject.__all__))


@pytest.mark.parametrize("name", PACKAGES)
def test_a_package_lists_what_is_there_once(name: str) -> None:
    package = getattr(unproject, name)
    assert len(package.__all__) == len(set(package.__all__))
    assert all(hasattr(package, public) for public in package.__all__)


def test_a_name_means_the_same_everywhere() -> None:
    """A class or function of the package that several lists name is one object."""
    found: dict[str, set[int]] = {}
    for package in (unproject, *(getattr(unproject, name) for name in PACKAGES)):
        for name in package.__all__:
            if isinstance(getattr(package, name), type):
                found.setdefault(name, set()).add(id(getattr(package, name)))
    assert [name for name, objects in found.items() if len(objects) > 1] == []


def test_all_that_a_recipe_is_made_of_is_exported() -> None:
    """Parameters of `Recipe` and `Panel` that are classes of ours can be written with `unproject.` names alone."""
    wanted = {"Recipe", "Panel", "Adam", "R1R2", "GradientPenalty", "Relativistic", "Wasserstein", "Hinge", "Logistic"}
    wanted |= {"Known", "Predicted", "LearnedPrior", "Unassigned", "Rounds", "PredictorFit", "Estimator", "Run"}
    assert wanted <= set(unproject.__all__)


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
