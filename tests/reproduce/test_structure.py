"""Networks are listed as they are built."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from unproject.cli import main
from unproject.recipes import find
from unproject.reproduce.structure import layers, tables


def learned(table: str) -> list[int]:
    """The last column, the sum at its end."""
    rows = [re.split(r"  +", line) for line in table.splitlines()[1:]]
    return [int(row[-1].replace(",", "")) for row in rows if len(row) == 4 or row[0] == "in all"]


@pytest.mark.parametrize("name", ["digits-paper", "shapes-paper", "wood-paper"])
def test_every_learned_number_is_listed(name: str) -> None:
    flags = {"maps": 2, "renderings": 2, "batch": 4} if name == "wood-paper" else {"views": "predicted"}
    recipe = find(name)(size=16, channels=8, steps=1, **flags)
    found = tables(recipe)
    for table in found.values():
        assert learned(table)[-1] == sum(learned(table)[:-1]) > 0
    assert learned(found["generator"])[-1] == sum(p.numel() for p in recipe.generator().parameters())


def test_the_networks_are_named() -> None:
    recipe = find("shapes-paper")(size=16, channels=8, views="predicted", steps=1, views_per_shape=1)
    found = tables(recipe)
    assert list(found) == ["generator", "discriminator of azimuth, 16 heads", "view predictor"]
    assert "normed" in found["discriminator of azimuth, 16 heads"] and "normed" not in found["generator"]


def test_hooks_are_taken_off_again() -> None:
    generator = find("digits-paper")(size=16, channels=8, steps=1).generator()
    with pytest.raises(RuntimeError):
        layers(generator, lambda: (_ for _ in ()).throw(RuntimeError()))
    assert not any(module._forward_hooks for module in generator.modules())


def test_fig6_is_printed_and_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["reproduce", "fig6", "--out", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert text == (tmp_path / "cpu" / "fig6.txt").read_text()
    for part in ("branches.roughness", "discriminator of grazing", "minibatch", "9,060,491"):
        assert part in text
