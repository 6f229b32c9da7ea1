"""Runs of recipes that a script or a user's own function made are opened again by their folder alone."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from toy import SIZE, toy

import unproject as up
from unproject._types import UserError
from unproject.training import Recipe, load, resumable, resume, train
from unproject.training.building import foreign_code
from unproject.training.run_directory import read_recipe

SCRIPT = """
import functools, torch, unproject as up

class Blobs(up.Generator):
    domain = "images"

    def __init__(self):
        super().__init__(code_size=4)
        self.layer = torch.nn.Linear(4, 256)

    def forward(self, code):
        return self.layer(code).sigmoid().view(-1, 1, 16, 16)

@up.resumable
def recipe(count=8, **options):
    images = torch.arange(count * 256.0).view(count, 1, 16, 16) / (count * 256)
    panel = up.Panel([up.Observation("itself", up.Identity())], up.Collection(images))
    judge = functools.partial(up.networks.Discriminator, channels=4)
    return up.Recipe(Blobs, [panel], discriminator=judge, steps=1, batch=4).configured(options)

up.train(recipe(6), "run", quiet=True)  # a script without `if __name__ == "__main__"`
print(up.load("run", trust=True).step)
"""


def test_a_run_of_a_script_is_opened_by_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forked: None
) -> None:
    script = tmp_path / "mine.py"
    script.write_text(SCRIPT)
    ran = subprocess.run([sys.executable, "mine.py"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (ran.returncode, ran.stdout) == (0, "1\n"), ran.stderr
    stored = read_recipe(tmp_path / "run")
    assert stored["recipe"] == f"{script}:recipe" and stored["arguments"] == {"count": 6}
    assert stored["resolved"]["generator"]["call"] == "_unproject_mine:Blobs"
    # Elsewhere the file is imported, which trains nothing if it is written as one that can be.
    script.write_text(SCRIPT.partition("up.train(")[0])
    monkeypatch.chdir(tmp_path.parent)
    assert load(tmp_path / "run", trust=True).sample(2).shape == (2, 1, 16, 16)
    assert resume(tmp_path / "run", steps=2, trust=True, quiet=True).step == 2


def test_a_generator_that_nothing_can_import_is_named(tmp_path: Path) -> None:
    recipe = toy(steps=1, views="direct")
    run = train(recipe.replace(generator=lambda: recipe.generator()), tmp_path / "run", quiet=True)
    with pytest.raises(UserError, match=r"its generator is a lambda .*; open it by its recipe"):
        load(run.path, trust=True)
    content = (run.path / "recipe.json").read_text()
    (run.path / "recipe.json").write_text(content.replace("<locals>.<lambda>", "x").replace("test_scripts:", "gone:"))
    with pytest.raises(UserError, match=r"there is no module '[a-z.]*gone' here; run from its folder"):
        load(run.path, trust=True)


@resumable
def volumes(count: int = 4, data: Path | None = None, *more: int, side: int = SIZE, **options: Any) -> Recipe:
    panel = up.Panel([up.Observation("itself", up.Identity())], up.Collection(up.data.chairs(count, side)))
    return up.Recipe(up.networks.LowRankGenerator, [panel], steps=1).configured(options)


def test_positional_arguments_and_paths_given_as_strings_are_remembered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir("/tmp")
    origin = volumes(3, "masks", seed=2).origin  # type: ignore[arg-type]
    assert origin is not None
    assert origin.arguments == {"count": 3, "data": {"path": "/tmp/masks"}, "seed": 2}
    assert volumes(3, None, 7).origin is None  # what has no name cannot be given again


@pytest.mark.parametrize("generator", [[], "x", None, {"call": 3}])
def test_what_a_damaged_recipe_names_is_not_foreign(tmp_path: Path, generator: object) -> None:
    content = {"recipe": "", "arguments": {}, "resolved": {"generator": generator, "domain": []}}
    (tmp_path / "recipe.json").write_text(json.dumps(content))
    assert bool(foreign_code(tmp_path)) == (generator == {"call": 3})
