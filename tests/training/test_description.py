"""What recipe.json says of a recipe, and when two descriptions are of one."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from toy import toy

from unproject import recipes
from unproject._types import UserError
from unproject.data import Collection, chairs
from unproject.training import resume, train
from unproject.training.description import describe, matches

NOISE = torch.Generator().manual_seed(0)


def stored(value: Any) -> Any:
    """As it comes back from recipe.json."""
    return json.loads(json.dumps(describe(value)))


@pytest.mark.parametrize("shape", [(), (5,), (1000, 1, 8, 8), (3000, 4)])
def test_the_last_bits_are_not_what_tells_data_apart(shape: tuple[int, ...]) -> None:
    x = torch.rand(shape, generator=NOISE)
    rounded = x * (1 + 1e-7 * torch.randn(shape, generator=NOISE))
    assert matches(stored(x), stored(rounded))
    assert matches(stored({"data": [x]}), stored({"data": [rounded]}))


def test_another_picture_is_told_and_another_order(shape: tuple[int, ...] = (3000, 1, 8, 8)) -> None:
    x = torch.rand(shape, generator=NOISE)
    other = x.clone()
    other[1234] = torch.rand(shape[1:], generator=NOISE)
    assert not matches(stored(Collection(x)), stored(Collection(other)))
    assert not matches(stored(Collection(x)), stored(Collection(x.roll(1, 0))))
    assert not matches(stored(Collection(x)), stored(Collection(x.flip(3))))
    assert not matches(stored(Collection(x)), stored(Collection(x[:-1])))


def test_pictures_in_bytes_are_told_by_each_of_them() -> None:
    x = torch.randint(256, (3000, 1, 8, 8), generator=NOISE, dtype=torch.uint8)
    other = x.clone()
    other[7, 0, 0, 0] ^= 1
    assert matches(stored(Collection(x)), stored(Collection(x.clone())))
    assert not matches(stored(Collection(x)), stored(Collection(other)))


def test_runs_of_before_there_were_sketches_are_told_by_their_digest() -> None:
    x = torch.rand(30, 1, 8, 8, generator=NOISE)
    before = {key: value for key, value in stored(x).items() if key != "sketch"}
    assert matches(before, stored(x)) and not matches(before, stored(x * (1 + 1e-6)))


def test_numbers_match_up_to_rounding_and_all_else_exactly() -> None:
    now = {"rate": 0.002, "steps": 5, "names": ["a"]}
    assert matches(now, now | {"rate": 0.002 * (1 + 1e-7)})
    for other in ({"rate": 0.0021}, {"steps": 6}, {"names": ["b"]}, {"names": ["a", "b"]}, {"more": 1}):
        assert not matches(now, now | other), other


def test_a_run_goes_on_where_silhouettes_are_rendered_by_another_kernel(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    np.savez(tmp_path / "chairs.npz", voxels=chairs(12, 16, seed=3).numpy() > 0.5)
    narrow = {"data": tmp_path / "chairs.npz", "views": "known", "size": 16, "batch": 8, "views_per_sample": 2}
    run = train(recipes.find("shapes")(steps=1, channels=16, rank=4, **narrow), tmp_path / "run", quiet=True)
    monkeypatch.setenv("UNPROJECT_NATIVE", "0")
    assert resume(run.path, steps=2, quiet=True).step == 2
    np.savez(tmp_path / "chairs.npz", voxels=chairs(12, 16, seed=4).numpy() > 0.5)
    differ = r"run: the data differ from those that the run was started with \(.*\); restore them, or begin"
    with pytest.raises(UserError, match=differ) as told:
        resume(run.path, steps=3, quiet=True)
    assert "items then" not in str(told.value)
    np.savez(tmp_path / "chairs.npz", voxels=chairs(10, 16, seed=3).numpy() > 0.5)
    with pytest.raises(UserError, match=r"\(.*chairs.npz.*: 192 items then, 160 now\); restore them"):
        resume(run.path, steps=3, quiet=True)


def test_held_out_pictures_are_counted_with_the_data(tmp_path: Path) -> None:
    recipe = toy(views="predicted", steps=1)
    (panel,) = recipe.panels
    held_out = Collection(panel.collections[0].items[:3])
    run = train(recipe.replace(panels=[replace(panel, held_out=held_out)]), tmp_path / "run", quiet=True)
    fewer = recipe.replace(panels=[replace(panel, held_out=Collection(held_out.items[:2]))])
    count = len(panel)
    with pytest.raises(UserError, match=rf"\(.*: {count + 3} items then, {count + 2} now\); restore them"):
        resume(run.path, fewer, quiet=True)


def test_what_differs_of_panels_beside_their_data_is_their_panels(tmp_path: Path) -> None:
    recipe = toy(views="known", steps=1)
    run = train(recipe, tmp_path / "run", quiet=True)
    (panel, *others) = recipe.panels
    with pytest.raises(UserError, match="panels differs from when the run was started; resume with the same recipe"):
        resume(run.path, recipe.replace(panels=[replace(panel, weight=2.0), *others], steps=2), quiet=True)


@pytest.mark.parametrize("damaged", [None, "x", 3, [None, 1.0]])
def test_a_damaged_sketch_is_not_near(damaged: object) -> None:
    described = stored(torch.rand(4, 8))
    assert matches(described, described) and not matches({**described, "sketch": damaged}, described)
