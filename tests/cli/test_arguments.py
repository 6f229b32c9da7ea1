"""Signatures become flags, and a wrong flag becomes one line that names the right one."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any, Literal

import pytest
import torch

from unproject._types import UserError
from unproject.assignment import Panel
from unproject.cli import _arguments
from unproject.cli._arguments import HelpPrinted, bind, bind_recipe, find_recipe
from unproject.data import Collection
from unproject.networks import LowRankGenerator
from unproject.projections.base import Identity
from unproject.projections.observation import Observation
from unproject.training import Options, Recipe


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
    """Draw samples.

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
        ("a --rate fast", "--rate 'fast': give a number"),
        ("a --n", "missing value for argument '--n'"),
        ("a --mode guessed", "choose from known, predicted"),
    ],
)
def test_mistakes(argv: str, said: str) -> None:
    with pytest.raises(UserError) as caught:
        call(*argv.split())
    message = str(caught.value)
    assert message.startswith("sample: ") and message.endswith("(`unproject sample --help`)")
    assert said in message
    assert not set("│╭╰─\n") & set(message)


@pytest.mark.parametrize(
    ("argv", "what"), [(["a", "--out", ""], "--out"), (["a", "--out="], "--out"), ([""], "an argument")]
)
def test_an_empty_argument_is_not_the_current_folder(argv: list[str], what: str) -> None:
    with pytest.raises(UserError, match=f"^sample: {what} is empty; is a variable of the shell not set"):
        call(*argv)
    assert call("a", "--out=x=")[4] == Path("x=")


def test_help_is_the_docstring(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(HelpPrinted):
        call("--help")
    text = " ".join(capsys.readouterr().out.split())
    assert "usage: unproject sample" in text and "Draw samples." in text
    assert "Where the run is." in text and "How many, in all. (default: 16)" in text


def recipe_of(size: int = 16, lr=1e-4, steps: int = 2000, *, smooth: bool = True, generator: object = None) -> Recipe:
    """A recipe of this test.

    Args:
        size: Edge of the volume.
        smooth: blur it.
    """
    made.append(dict(size=size, lr=lr, steps=steps, smooth=smooth, generator=generator))
    panel = Panel([Observation("volume", Identity())], Collection(torch.zeros(2, 8, 8, 8)))
    return Recipe(partial(LowRankGenerator, size=8), [panel], steps=steps)


made: list[dict[str, Any]] = []


def train(recipe: Recipe, /, *, device: str = "cpu") -> tuple[Recipe, str]:
    """Train.

    Args:
        device: Where to compute.
    """
    return recipe, device


@pytest.fixture
def birds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_arguments, "find_recipe", lambda name: recipe_of)
    made.clear()


@pytest.mark.usefixtures("birds")
def test_a_recipes_parameters_are_flags() -> None:
    flags = ["--size", "64", "--lr=1", "--no-smooth", "--device", "cuda"]
    recipe, device = bind_recipe("train", ["birds", *flags], train)()
    own = dict(size=64, lr=1.0, steps=2000, smooth=False)
    assert made == [own | {"generator": None}] and device == "cuda"
    assert recipe.origin is not None and recipe.origin.recipe == "birds" and recipe.origin.arguments == own


@pytest.mark.usefixtures("birds")
def test_options_of_every_recipe_are_flags_of_one_that_takes_none() -> None:
    """A recipe function of a user's own need not know them."""
    flags = ["--steps", "7", "--batch", "12", "--seed", "3", "--compile", "--precision", "bfloat16"]
    recipe, _ = bind_recipe("train", ["birds", *flags, "--ema-half-life", "9"], train)()
    assert made[0]["steps"] == recipe.steps == 7
    assert (recipe.batch, recipe.seed, recipe.compile, recipe.precision) == (12, 3, True, "bfloat16")
    assert recipe.ema_half_life == 9.0 and recipe.origin is not None
    given = {"batch": 12, "seed": 3, "compile": True, "precision": "bfloat16", "ema_half_life": 9.0}
    assert given.items() <= recipe.origin.arguments.items()
    zero, _ = bind_recipe("train", ["birds", "--ema-half-life", "0", "--balance-every", "0"], train)()
    assert (
        zero.origin is not None and {"ema_half_life": 0.0, "balance_every": 0}.items() <= zero.origin.arguments.items()
    )
    assert zero.ema_half_life == 0.0
    by_clock, _ = bind_recipe("train", ["birds", "--minutes", "2"], train)()
    assert (by_clock.steps, by_clock.minutes) == (None, 2.0)


@pytest.mark.usefixtures("birds")
def test_recipe_help_shows_both(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(HelpPrinted):
        bind_recipe("train", ["birds", "--help"], train)
    text = " ".join(capsys.readouterr().out.split())
    assert "Edge of the volume." in text and "Where to compute." in text
    assert "--generator" not in text
    assert "--no-smooth turn off: blur it" in text and "True" not in text
    assert all(f"--{name.replace('_', '-')}" in text for name in (*Options.__annotations__, "seed"))


@pytest.mark.usefixtures("birds")
def test_a_misspelt_recipe_flag() -> None:
    with pytest.raises(UserError, match="^train birds: .*Perhaps you meant `--no-smooth`"):
        bind_recipe("train", ["birds", "--no-smoth"], train)


def test_help_without_a_recipe(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(HelpPrinted):
        bind_recipe("train", ["--help"], train)
    assert "--device" in capsys.readouterr().out


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
