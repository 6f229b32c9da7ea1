"""`unproject recipes`."""

from __future__ import annotations

from pathlib import Path

import pytest

from unproject import recipes
from unproject.cli import main


@pytest.mark.parametrize("argv", [["recipes"], ["recipes", "list"]])
def test_every_recipe_is_listed(argv: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(argv) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == list(recipes.names())


@pytest.mark.parametrize("name", recipes.names())
def test_every_recipe_can_be_shown(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recipes", "show", name]) == 0
    text = capsys.readouterr().out
    assert text.startswith(f"{name}\n") and "  --seed int (default: 0)" in text and "(no docstring)" not in text


def test_a_recipe_of_ones_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.py").write_text('def birds(size: int = 3):\n    """Birds."""\n', encoding="utf-8")
    assert main(["recipes", "show", f"{tmp_path}/mine.py:birds"]) == 0
    assert "Birds." in capsys.readouterr().out


@pytest.mark.parametrize(
    "argv, said",
    [
        (["recipes", "show"], "name the recipe"),
        (["recipes", "show", "shaeps"], "Perhaps you meant 'shapes'"),
        (["recipes", "shw"], "action 'shw': choose from list, show. Perhaps you meant 'show'"),
    ],
)
def test_mistakes(argv: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(argv) == 2
    err = capsys.readouterr().err
    assert err.startswith("unproject: ") and err.count("\n") == 1 and said in err
