"""Finding recipes, and what recipe.json must remember to call one again."""

from __future__ import annotations

import inspect
import json
from dataclasses import asdict
from pathlib import Path

import pytest

from unproject._objects import find_object
from unproject._types import UserError
from unproject.assignment import Predicted
from unproject.recipes import find, names
from unproject.recipes.shapes import shapes, shapes_paper
from unproject.training import Origin, make, rebuild
from unproject.training.description import describe


def through_json(origin: Origin | None) -> Origin:
    assert origin is not None
    return Origin(**json.loads(json.dumps(asdict(origin))))


@pytest.fixture
def foreign(tmp_path: Path) -> str:
    """A recipe in a user's file, which leaves a trace when its code runs."""
    file = tmp_path / "mine.py"
    trace = "from pathlib import Path\nPath(__file__).with_name('trace').touch()\n"
    recipe = "from unproject.recipes.digits import digits\ndef recipe(*, size=16): return digits(size=size, steps=3)\n"
    file.write_text(trace + recipe, encoding="utf-8")
    return f"{file}:recipe"


def test_every_name_finds_a_function_with_a_line_about_it() -> None:
    assert find("shapes") is shapes and find("shapes-paper") is shapes_paper
    for name, line in names().items():
        assert callable(find(name)) and line and "\n" not in line


@pytest.mark.parametrize("wrong, right", [("shape", "shapes"), ("shapes_paper", "shapes-paper")])
def test_an_unknown_name_suggests_the_nearest(wrong: str, right: str) -> None:
    with pytest.raises(UserError, match=f"there is no recipe '{wrong}'. Perhaps you meant '{right}'.*lists all"):
        find(wrong)


def test_a_name_like_no_other_suggests_nothing() -> None:
    with pytest.raises(UserError, match="there is no recipe 'xyzzy'; shapes, digits and materials .* lists all"):
        find("xyzzy")


def test_a_recipe_survives_json(volumes: Path) -> None:
    arguments = {"data": volumes, "size": 16, "steps": 7, "rounds": 2, "mirror": True, "views": "predicted"}
    again = rebuild(through_json(make("shapes", shapes, arguments).origin))
    assert describe(again) == describe(shapes(**arguments))
    assignment = again.panels[0].assignment
    assert again.steps == 7 and isinstance(assignment, Predicted) and len(assignment.rounds.starts) == 2


def test_a_recipe_that_python_made_remembers_how(volumes: Path) -> None:
    """Its run resumes by path alone; fields that are no option cannot be given to its function again."""
    made = shapes(data=volumes, size=16, steps=7)
    assert describe(rebuild(through_json(made.origin))) == describe(made)
    changed = made.replace(minutes=1.0, batch=16)
    assert describe(rebuild(through_json(changed.origin))) == describe(changed)
    assert made.replace(penalty=None).origin is None


@pytest.mark.parametrize("name", names())
def test_every_recipe_takes_the_options(name: str) -> None:
    """`Options` names them; `train` gives them to a recipe as flags."""
    assert any(p.kind is p.VAR_KEYWORD for p in inspect.signature(find(name)).parameters.values())


def test_a_path_is_remembered_from_the_root(volumes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(volumes.parent)
    remembered = through_json(make("shapes", shapes, {"data": Path(volumes.name), "size": 16}).origin)
    monkeypatch.chdir("/")
    assert describe(rebuild(remembered)) == describe(shapes(data=volumes, size=16))


def test_a_users_file_is_remembered_from_the_root(foreign: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(Path(foreign).parent)
    made = make("mine.py:recipe", find_object("mine.py:recipe"), {"size": 32, "batch": 8})
    monkeypatch.chdir("/")
    again = rebuild(through_json(made.origin), trust=True)
    assert describe(again) == describe(made) and again.batch == 8
    assert again.generator().sample(1).shape == (1, 1, 32, 32)


def test_some_arguments_can_be_changed(volumes: Path) -> None:
    made = make("shapes", shapes, {"data": volumes, "size": 16, "steps": 7})
    assert rebuild(made.origin, steps=9).steps == 9
    by_clock = rebuild(made.origin, minutes=2.0)
    assert (by_clock.steps, by_clock.minutes) == (None, 2.0)


def test_an_argument_that_is_no_longer_there_is_named(volumes: Path) -> None:
    arguments = {"data": str(volumes), "width": 3, "colour": "red"}
    with pytest.raises(UserError, match="does not take colour, width; use the version that the run began with"):
        rebuild(Origin("shapes", "unproject.recipes.shapes:shapes", arguments))


def test_a_run_without_a_recipe_function_is_not_rebuilt() -> None:
    for origin in (None, Origin("", "", {})):
        with pytest.raises(UserError, match=r"built in Python; give it: unproject.resume\(path, recipe\)"):
            rebuild(origin)


def test_foreign_code_runs_only_with_trust(foreign: str, tmp_path: Path) -> None:
    origin = Origin(foreign, foreign, {"size": 32})
    with pytest.raises(UserError, match=r"code outside unproject; add --trust \(trust=True\)"):
        rebuild(origin)
    assert not (tmp_path / "trace").exists()
    assert rebuild(origin, trust=True).generator().sample(1).shape[-1] == 32
    assert (tmp_path / "trace").exists()


@pytest.mark.parametrize(
    "function",
    ["unproject.training.environment:subprocess.getoutput", "unproject.cli:__builtins__.exec", "os:system"],
)
def test_only_recipe_functions_of_the_package_run_without_trust(
    function: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What a module of the package has imported is not the package's."""
    monkeypatch.chdir(tmp_path)
    for arguments in ({"cmd": "touch exploded"}, {}):
        with pytest.raises(UserError, match="add --trust|name something it defines"):
            rebuild(Origin("shapes", function, arguments))
    assert not list(tmp_path.iterdir())


def test_views_that_are_none_are_refused() -> None:
    with pytest.raises(UserError, match="views='knwon': choose from predicted, learned, known, single, direct"):
        find("shapes")(views="knwon", size=16)
