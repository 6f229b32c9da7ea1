"""Finding recipes, and what recipe.json must remember to call one again."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from unproject._types import UserError
from unproject.recipes import find, names, origin, rebuild
from unproject.recipes.shapes import shapes, shapes_paper
from unproject.training.recipe import describe
from unproject.training.run_directory import Origin


def through_json(remembered: Origin) -> Origin:
    stored = json.loads(json.dumps({"recipe": remembered.recipe, "arguments": remembered.arguments}))
    return Origin(stored["recipe"], stored["arguments"])


@pytest.fixture
def foreign(tmp_path: Path) -> str:
    """A recipe in a user's file, which leaves a trace when its code runs."""
    file = tmp_path / "mine.py"
    trace = "from pathlib import Path\nPath(__file__).with_name('trace').touch()\n"
    file.write_text(trace + "def recipe(size=3): return size\n", encoding="utf-8")
    return f"{file}:recipe"


def test_every_name_finds_a_function_with_a_line_about_it() -> None:
    assert find("shapes") is shapes and find("shapes-paper") is shapes_paper
    for name, line in names().items():
        assert callable(find(name)) and line and "\n" not in line


@pytest.mark.parametrize("wrong, right", [("shape", "shapes"), ("shapes_paper", "shapes-paper")])
def test_an_unknown_name_suggests_the_nearest(wrong: str, right: str) -> None:
    with pytest.raises(UserError, match=f"there is no recipe '{wrong}'. Perhaps you meant '{right}'.*lists them"):
        find(wrong)


def test_a_name_like_no_other_suggests_nothing() -> None:
    with pytest.raises(UserError, match="there is no recipe 'xyzzy'; `unproject recipes` lists them"):
        find("xyzzy")


def test_a_recipe_survives_json(volumes: Path) -> None:
    arguments = {"data": volumes, "size": 16, "steps": 7, "rounds": 2, "mirror": True, "views": "predicted"}
    again = rebuild(through_json(origin("shapes", arguments)))
    assert describe(again) == describe(shapes(**arguments))
    assert again.steps == 7 and len(again.assignment.starts) == 2  # type: ignore[union-attr]


def test_a_path_is_remembered_from_the_root(volumes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(volumes.parent)
    remembered = through_json(origin("shapes", {"data": Path(volumes.name), "size": 16}))
    monkeypatch.chdir("/")
    assert describe(rebuild(remembered)) == describe(shapes(data=volumes, size=16))


def test_a_users_file_is_remembered_from_the_root(foreign: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(foreign).parent)
    remembered = through_json(origin("mine.py:recipe", {"size": 4}))
    monkeypatch.chdir("/")
    assert rebuild(remembered, trust=True) == 4


def test_some_arguments_can_be_changed(volumes: Path) -> None:
    remembered = origin("shapes", {"data": volumes, "size": 16, "steps": 7})
    assert rebuild(remembered, steps=9).steps == 9


def test_an_argument_that_is_no_longer_there_is_named(volumes: Path) -> None:
    with pytest.raises(UserError, match="recipe shapes no longer takes colour, width; use the version that began it"):
        rebuild(Origin("shapes", {"data": str(volumes), "width": 3, "colour": "red"}))


def test_a_run_without_a_recipe_function_is_not_rebuilt() -> None:
    with pytest.raises(UserError, match="started from Python"):
        rebuild(Origin("", {}))


def test_foreign_code_runs_only_with_trust(foreign: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="code outside unproject; add --trust if you wrote it"):
        rebuild(Origin(foreign, {"size": 5}))
    assert not (tmp_path / "trace").exists()
    assert rebuild(Origin(foreign, {"size": 5}), trust=True) == 5
    assert (tmp_path / "trace").exists()
