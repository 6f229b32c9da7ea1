"""Networks are listed as they are built."""

from __future__ import annotations

from pathlib import Path

import pytest

from unproject.cli import main
from unproject.recipes import find
from unproject.reproduce.structure import layers, tables


def test_every_learned_number_is_listed() -> None:
    recipe = find("digits-paper")(size=16, channels=8, views="predicted", steps=1)
    found = tables(recipe)
    assert list(found) == ["generator", "discriminator of direction, 10 heads", "view predictor"]
    generator = recipe.generator()
    lines = found["generator"].splitlines()
    last = [line.split()[-1].replace(",", "") for line in lines[1:]]
    counts = [int(word) for word in last if word.isdigit()]
    assert counts[-1] == sum(p.numel() for p in generator.parameters()) == sum(counts[:-1])


def test_hooks_are_taken_off_again() -> None:
    generator = find("digits-paper")(size=16, channels=8, steps=1).generator()
    with pytest.raises(RuntimeError):
        layers(generator, lambda: (_ for _ in ()).throw(RuntimeError()))
    assert not any(module._forward_hooks for module in generator.modules())


def test_fig6_is_printed_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "fig6", "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert text == (tmp_path / "fig6.txt").read_text()
    for part in ("branches.roughness", "discriminator of grazing", "minibatch", "9,060,491"):
        assert part in text
