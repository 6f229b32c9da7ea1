"""Mistakes on the command line: one line, in plain words, with what was perhaps meant."""

from __future__ import annotations

from pathlib import Path

import pytest

from unproject.cli import main
from unproject.cli._mistakes import in_one_line


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("export", "export: give SOURCE and --out PATH (`unproject export --help`)"),
        ("export run", "export: give --out PATH (`"),
        (
            "data inspct x",
            "data 'inspct': choose from inspect, pack, get; flags come behind. Perhaps you meant 'inspect' (`",
        ),
        ("data", "data '': choose from inspect, pack, get"),
        ("data --strict inspect x", "data '--strict': choose from inspect, pack, get; flags come behind (`"),
        ("data get mnist --strict", "data get: unrecognized options: --strict"),
        ("data pack x --json", "data pack: unrecognized options: --json"),
        ("inspect x", "there is no verb 'inspect'. Perhaps you meant 'data inspect'; `"),
        ("train shapes --views knwn", "--views 'knwn': choose from predicted, learned, known, single, direct. Perhaps"),
        ("train shapes --steps x", "--steps 'x': give a whole number (`"),
        ("train shapes --rate x", "--rate 'x': give a number (`"),
        ("train shapes --stesp 3", "unrecognized options: --stesp, 3. Perhaps you meant `--steps` (`"),
        ("train shapes ./", "unrecognized options: ./. Perhaps you meant `--data ./` (`"),
        ("train shapes ./nowhere", "unrecognized options: ./nowhere (`"),
    ],
)
def test_mistakes_are_said_in_plain_words(line: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(line.split()) == 2
    err = capsys.readouterr().err
    assert err.startswith("unproject: ") and err.count("\n") == 1 and said in err


@pytest.mark.parametrize(
    "frame", ["╭─ Value error ─╮\n│ {} │\n│ ─── │\n│ more │\n╰──╯\n", " Value error \n ---- \n  {} \n  ----\n  more\n"]
)
def test_both_frames_of_a_mistake_are_understood(frame: str) -> None:
    """Lines of Unicode, and hyphens where letters are not UTF-8."""
    assert in_one_line(frame.format("No 3 is left.")) == "no 3 is left"


def test_a_long_path_is_not_broken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    long = tmp_path / ("a-folder-of-pictures-" * 6) / "cutouts"
    long.mkdir(parents=True)
    assert main(["train", "shapes", str(long)]) == 2
    assert f"Perhaps you meant `--data {long}`" in capsys.readouterr().err
    assert main(["train", "shapes", "x" * 300]) == 2
    assert "unrecognized options: xxx" in capsys.readouterr().err


def test_what_is_no_run_says_what_there_is(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "runs" / "birds").mkdir(parents=True)
    (tmp_path / "runs" / "birds" / "recipe.json").write_text("{}", encoding="utf-8")
    for path, said in (
        ("runs", "not a run directory (no recipe.json, but those of birds below)"),
        ("runs/bids", "not a run directory (there is no such folder)"),
        ("runs/example-chairs", "(there is no such folder; `unproject studio --example` makes it)"),
    ):
        assert main(["evaluate", str(tmp_path / path)]) == 2
        assert said in capsys.readouterr().err


def test_a_place_that_is_taken_is_refused_before_anything_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "recipe.json").write_text("{}", encoding="utf-8")
    assert main(["train", "shapes", "--size", "16", "--steps", "1", "--out", str(tmp_path)]) == 2
    said = capsys.readouterr()
    assert "holds a run already" in said.err and said.out == ""


@pytest.mark.parametrize(
    ("run", "flags"), [("taken", ["--out", "taken"]), ("runs/shapes-0", []), ("runs/shapes-7", ["--seed", "7"])]
)
def test_a_place_that_is_taken_is_refused_before_the_data_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], run: str, flags: list[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(run).mkdir(parents=True)
    (Path(run) / "recipe.json").write_text("{}", encoding="utf-8")
    assert main(["train", "shapes", "--data", "missing", *flags]) == 2
    assert capsys.readouterr().err.startswith(f"unproject: {run}: holds a run already")
