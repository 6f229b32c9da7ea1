"""Signatures become flags, and a wrong flag becomes one line that names the right one."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest

from unproject._types import UserError
from unproject.cli import _arguments
from unproject.cli._arguments import HelpPrinted, bind, bind_recipe, find_recipe


def sample(
    run: Path,
    more: tuple[str, ...] = (),
    /,
    *,
    n: int = 16,
    rate: float | None = None,
    out: Path | None = None,
    json: bool = False,
    mirror: bool = True,
    mode: Literal["known", "predicted"] = "known",
) -> tuple:
    """Draw things.

    Args:
        run: Where the run is.
        n: How many,
            in all.
    """
    return run, more, n, rate, out, json, mirror, mode


def call(*argv: str):
    return bind("sample", argv, sample)[0]()


def test_defaults() -> None:
    assert call("runs/a") == (Path("runs/a"), (), 16, None, None, False, True, "known")


def test_flags_and_arguments() -> None:
    argv = "runs/a b c --n 3 --rate 1e-3 --out x --json --no-mirror --mode predicted"
    assert call(*argv.split()) == (Path("runs/a"), ("b", "c"), 3, 1e-3, Path("x"), True, False, "predicted")


@pytest.mark.parametrize(
    "argv, said",
    [
        ("", "RUN"),
        ("a --nn 3", "--nn, 3. Perhaps you meant `--n`"),
        ("a --no-mirorr", "Perhaps you meant `--no-mirror`"),
        ("a --n three", "--n"),
        ("a --rate fast", "could not convert string to float: 'fast'"),
        ("a --n", "missing value for argument '--n'"),
        ("a --mode guessed", "'known', 'predicted'"),
    ],
)
def test_mistakes(argv: str, said: str) -> None:
    with pytest.raises(UserError) as caught:
        call(*argv.split())
    message = str(caught.value)
    assert message.startswith("sample: ") and message.endswith("(`unproject sample --help`)")
    assert said in message
    assert not set("│╭╰─\n") & set(message)


def test_help_is_the_docstring(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(HelpPrinted):
        call("--help")
    text = " ".join(capsys.readouterr().out.split())
    assert "usage: unproject sample" in text and "Draw things." in text
    assert "Where the run is." in text and "How many, in all. (default: 16)" in text


def recipe_of(size: int = 32, lr=1e-4, steps: int = 2000, *, smooth: bool = True, generator: object = None) -> dict:
    """A recipe of this test.

    Args:
        size: Edge of the volume.
    """
    return dict(size=size, lr=lr, steps=steps, smooth=smooth, generator=generator)


def train(recipe: dict, origin: object, /, *, seed: int = 0, steps: int | None = None) -> tuple:
    """Train.

    Args:
        seed: Where randomness starts.
    """
    return recipe, origin, seed, steps


@pytest.fixture
def birds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_arguments, "find_recipe", lambda name: recipe_of)
    monkeypatch.setattr("unproject.recipes.origin", lambda name, flags: (name, flags))


@pytest.mark.usefixtures("birds")
def test_a_recipes_parameters_are_flags() -> None:
    recipe, origin, seed, steps = bind_recipe(
        "train", ["birds", "--size", "64", "--lr=1", "--no-smooth", "--seed", "3"], train
    )()
    assert recipe == dict(size=64, lr=1.0, steps=2000, smooth=False, generator=None)
    assert (seed, steps) == (3, 2000)
    assert origin == ("birds", dict(size=64, lr=1.0, steps=2000, smooth=False))


@pytest.mark.usefixtures("birds")
def test_a_shared_flag_reaches_both() -> None:
    recipe, _, _, steps = bind_recipe("train", ["birds", "--steps", "7"], train)()
    assert recipe["steps"] == steps == 7


@pytest.mark.usefixtures("birds")
def test_recipe_help_shows_both(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(HelpPrinted):
        bind_recipe("train", ["birds", "--help"], train)
    text = capsys.readouterr().out
    assert "Edge of the volume." in text and "Where randomness starts." in text
    assert "--generator" not in text


@pytest.mark.usefixtures("birds")
def test_a_misspelt_recipe_flag() -> None:
    with pytest.raises(UserError, match="^train birds: .*Perhaps you meant `--no-smooth`"):
        bind_recipe("train", ["birds", "--no-smoth"], train)


def test_help_without_a_recipe(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(HelpPrinted):
        bind_recipe("train", ["--help"], train)
    assert "--seed" in capsys.readouterr().out


def test_no_recipe() -> None:
    with pytest.raises(UserError, match="name a recipe first"):
        bind_recipe("train", ["--seed", "3"], train)


def test_a_parameter_that_cannot_be_typed_needs_a_default() -> None:
    def odd(x: object) -> None: ...

    with pytest.raises(UserError, match="odd: the command line cannot give 'x'"):
        bind("train", [], odd)


def test_a_recipe_of_ones_own(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("def birds(size: int = 3): return size\nnumber = 3\n")
    assert find_recipe(f"{tmp_path}/mine.py:birds")() == 3
    with pytest.raises(UserError, match="is no recipe"):
        find_recipe(f"{tmp_path}/mine.py:number")
