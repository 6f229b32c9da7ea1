"""The size that recipes learn at: chosen by the headers of the data, kept by the run."""

from __future__ import annotations

import gzip
import json
import shutil
import struct
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from unproject._types import UserError
from unproject.cli import main
from unproject.data import chairs, detectors_of, side_of
from unproject.recipes import find
from unproject.recipes.digits import digits, digits_paper
from unproject.recipes.shapes import shapes
from unproject.recipes.sizes import size_for, size_for_images
from unproject.training import Recipe, rebuild
from unproject.training.description import describe

SMALL: dict[str, Any] = {"bins": 2, "views_per_shape": 2, "channels": 8, "rank": 2, "steps": 2, "tries": 1}


@pytest.fixture(autouse=True)
def few_are_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """Toy folders count as large."""
    monkeypatch.setattr("unproject.recipes.sizes.MIN_PICTURES", 1)


def picture(path: Path, width: int, height: int) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    mask = np.zeros((height, width), np.uint8)
    mask[height // 4 : -height // 4, width // 3 : -width // 3] = 255
    Image.fromarray(mask).save(path)


def folder(path: Path, *sides: tuple[int, int]) -> Path:
    for i, (width, height) in enumerate(sides):
        picture(path / f"{i:03d}.png", width, height)
    return path


def generator_size(recipe: Recipe) -> int:
    assert isinstance(recipe.generator, partial)
    return recipe.generator.keywords["size"]


@pytest.mark.parametrize(
    "sides, side, size",
    [
        ([(64, 64)], 64, 64),
        ([(63, 900)], 63, 32),
        ([(900, 64)], 64, 64),
        ([(20, 20), (70, 90), (400, 300)], 70, 64),
        ([(20, 20), (30, 30), (400, 300)], 30, 32),
    ],
)
def test_of_a_folder_the_median_of_the_shorter_sides(
    tmp_path: Path, sides: list[tuple[int, int]], side: int, size: int
) -> None:
    data = folder(tmp_path / "masks", *sides)
    assert side_of(data) == side and size_for(data) == size


@pytest.mark.parametrize("budget, size", [({}, 64), ({"minutes": 29}, 32), ({"minutes": 30}, 64), ({"steps": 2}, 64)])
def test_short_budgets_are_spent_on_small_volumes(tmp_path: Path, budget: dict[str, int], size: int) -> None:
    data = folder(tmp_path / "masks", *[(80, 90)] * 12)
    few = {name: value for name, value in SMALL.items() if name != "steps"}
    assert generator_size(shapes(data=data, **few, **budget)) == size


def test_few_pictures_are_learned_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.recipes.sizes.MIN_PICTURES", 5)
    four, five = folder(tmp_path / "four", *[(80, 90)] * 4), folder(tmp_path / "five", *[(80, 90)] * 5)
    assert (size_for(four), size_for(five)) == (32, 64)
    np.savez(tmp_path / "volumes.npz", volume=np.zeros((2, 64, 64, 64), bool))
    assert size_for(tmp_path / "volumes.npz") == 64


def test_files_that_are_no_pictures_do_not_count(tmp_path: Path) -> None:
    data = folder(tmp_path / "masks", (80, 80), (80, 80), (80, 80))
    (data / "broken.png").write_bytes(b"\x89PNG\r\n\x1a\n cut")
    (data / "views.csv").write_text("file,azimuth\n")
    picture(data / ".hidden" / "a.png", 8, 8)
    assert side_of(data) == 80


@pytest.mark.parametrize(
    "shape, dtype, side",
    [
        ((3, 64, 64), np.uint8, 64),
        ((3, 1, 64, 80), np.uint8, 64),
        ((3, 48, 64, 3), np.uint8, 48),
        ((3, 64, 64, 64), bool, 64),
        ((3, 1, 40, 40, 40), np.float32, 40),
        ((3, 64), np.float32, None),
    ],
)
@pytest.mark.parametrize("suffix", [".npz", ".npy"])
def test_of_arrays_the_shape(
    tmp_path: Path, shape: tuple[int, ...], dtype: type, side: int | None, suffix: str
) -> None:
    values, path = np.zeros(shape, dtype), tmp_path / f"x{suffix}"
    name = "volume" if len(shape) == 5 else "lines" if len(shape) == 2 else "data"
    np.savez(path, **{name: values, "azimuth": np.zeros(3)}) if suffix == ".npz" else np.save(path, values)
    assert side_of(path) == side


def test_of_packed_archives_binvox_and_idx(tmp_path: Path) -> None:
    np.savez(tmp_path / "packed.npz", X_train=np.zeros((2, 8), np.uint8), shape=np.array([72, 72, 72]))
    assert side_of(tmp_path / "packed.npz") == side_of(f"{tmp_path / 'packed.npz'}:chair/test") == 72
    (tmp_path / "voxels").mkdir()
    for i, side in enumerate((30, 64, 128)):
        header = f"#binvox 1\ndim {side} {side} {side}\ntranslate 0 0 0\nscale 1\ndata\n".encode()
        (tmp_path / "voxels" / f"{i}.binvox").write_bytes(header + b"\0\xff" * 4)
    assert side_of(tmp_path / "voxels") == 64 and side_of(tmp_path / "voxels" / "2.binvox") == 128
    idx = b"\0\0\x08\x03" + struct.pack(">III", 10, 28, 30)
    (tmp_path / "plain-idx").write_bytes(idx)
    (tmp_path / "idx.gz").write_bytes(gzip.compress(idx + bytes(8400)))
    assert side_of(tmp_path / "plain-idx") == side_of(tmp_path / "idx.gz") == 28


@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04 cut", b"\0\0\x08\x09", b"text", b"\x1f\x8b cut"])
@pytest.mark.parametrize("name", ["x.npz", "x.npy", "x.binvox", "x.idx", "x.png", "mesh.obj"])
def test_what_cannot_be_told_is_left_to_the_reader(tmp_path: Path, name: str, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    assert side_of(tmp_path / name) is None and size_for(tmp_path / name) == 32
    assert side_of(tmp_path) is None


def test_thousands_of_pictures_are_not_all_opened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = folder(tmp_path / "many", (100, 90)) / "000.png"
    for i in range(1, 3000):
        (tmp_path / "many" / f"{i:04d}.png").hardlink_to(first)
    opened: list[Path] = []
    original = Image.open
    monkeypatch.setattr(Image, "open", lambda file: (opened.append(file), original(file))[1])
    began = time.process_time()
    assert size_for(tmp_path / "many") == 64
    assert len(set(opened)) == len(opened) == 256 and time.process_time() - began < 2
    numbers = sorted(int(file.stem) for file in opened)
    assert numbers[0] < 12 and numbers[-1] > 2980, "spread over the folder"


def test_procedural_chairs_stay_small_and_a_given_size_counts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 8)
    assert generator_size(shapes(**SMALL)) == 32
    np.savez(tmp_path / "large.npz", volume=chairs(8, 64).numpy() > 0.5)
    assert generator_size(shapes(data=tmp_path / "large.npz", **SMALL)) == 64
    assert generator_size(shapes(data=tmp_path / "large.npz", size=16, **SMALL)) == 16


def test_direct_training_stays_small(tmp_path: Path) -> None:
    np.savez(tmp_path / "large.npz", volume=chairs(8, 64).numpy() > 0.5)
    assert generator_size(shapes(data=tmp_path / "large.npz", views="direct", **SMALL)) == 32
    assert generator_size(shapes(data=tmp_path / "large.npz", views="direct", size=64, **SMALL)) == 64


def test_all_sizes_have_a_budget_of_4000_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("unproject.recipes.shape_panels.PROCEDURAL_CHAIRS", 8)
    small = {name: value for name, value in SMALL.items() if name != "steps"}
    assert shapes(size=32, **small).steps == shapes(size=64, **small).steps == 4000


def test_a_recipe_remembers_its_size(tmp_path: Path) -> None:
    path = tmp_path / "data.npz"
    np.savez(path, volume=chairs(8, 64).numpy() > 0.5)
    made = shapes(data=path, **SMALL)
    assert made.origin is not None and made.origin.arguments["size"] == 64
    np.savez(path, volume=chairs(8, 32).numpy() > 0.5)  # other data at the same place: the run stays what it was
    assert generator_size(rebuild(made.origin)) == 64


def test_a_run_of_the_command_line_resumes_at_its_size(tmp_path: Path) -> None:
    data, run, moved = tmp_path / "data.npz", tmp_path / "run", tmp_path / "moved"
    np.savez(data, lines=np.random.default_rng(0).random((12, 16)), angle=np.zeros(12))
    flags = ["--bins", "2", "--channels", "8", "--batch", "4", "--steps", "2", "--quiet"]
    assert main(["train", "digits", "--data", str(data), *flags, "--out", str(run)]) == 0
    stored = json.loads((run / "recipe.json").read_text())
    assert stored["arguments"]["size"] == 16 and stored["arguments"]["data"] == {"path": str(data)}
    shutil.copytree(run, moved)
    assert main(["resume", str(moved), "--steps", "3", "--quiet"]) == 0
    again = json.loads((moved / "recipe.json").read_text())
    assert again["resolved"]["generator"] == stored["resolved"]["generator"]


def test_inspect_shows_what_would_be_learned_from(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for side in (50, 100):
        data = folder(tmp_path / str(side), *[(side, side)] * 2)
        assert main(["data", "inspect", str(data), "--json"]) == 0
        wanted = 64 if side == 100 else 32
        assert json.loads(capsys.readouterr().out)["shape"] == [2, 1, wanted, wanted]
        assert main(["data", "inspect", str(data)]) == 0
        said, few = (line.strip() for line in capsys.readouterr().out.splitlines()[-2:])
        assert few == "2 pictures are few: a hundred at least are advised"
        assert said.startswith(f"shapes are learned at {wanted} voxels a side")
        assert said.endswith("; with --minutes under 30 at 32") == (wanted == 64)
        assert main(["data", "inspect", str(data), "--size", "48"]) == 0
        assert "are learned at" not in capsys.readouterr().out


def test_descriptions_differ_by_size(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", volume=chairs(8, 64).numpy() > 0.5)
    chosen, same, other = (
        shapes(data=tmp_path / "x.npz", **SMALL, **size) for size in ({}, {"size": 64}, {"size": 32})
    )
    assert describe(chosen) == describe(same) != describe(other)


@pytest.mark.parametrize("name", ["a.npz", "a.npy"])
def test_damaged_files_have_no_side_whatever_their_decoder_raises(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    save: Any = np.savez_compressed if name.endswith("z") else np.save
    save(path, np.random.default_rng(0).random((4, 70, 70)))
    whole, rng = path.read_bytes(), np.random.default_rng(1)
    for _ in range(60):
        damaged = bytearray(whole)
        for place in rng.integers(0, min(len(whole), 300), 4):
            damaged[place] = rng.integers(256)
        path.write_bytes(damaged)
        found = side_of(path)
        assert found is None or found > 0


@pytest.mark.parametrize("known", [True, False])
def test_inspect_says_that_views_are_known(known: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = folder(tmp_path / "masks", (40, 40), (40, 40))
    if known:
        rows = [f"{path.name},{90 * k}" for k, path in enumerate(sorted(data.glob("*.png")))]
        (data / "views.csv").write_text("\n".join(["file,azimuth", *rows]))
    assert main(["data", "inspect", str(data)]) == 0
    assert ("azimuths are known: --views known" in capsys.readouterr().out) == known


@pytest.mark.parametrize(
    "key, shape, size",
    [
        ("lines", (5, 64), 64),
        ("lines", (5, 1, 46), 64),
        ("lines", (5, 45), 32),
        ("sinograms", (3, 20, 7), 16),
        ("sinogram", (100, 7), 64),
        ("lines", (5, 5), 8),
        ("images", (5, 64, 64), 32),
    ],
)
def test_measured_lines_choose_the_size_of_pictures(
    tmp_path: Path, key: str, shape: tuple[int, ...], size: int
) -> None:
    data = tmp_path / "scans.npz"
    np.savez(data, **{key: np.full(shape, 0.5, np.float32)})
    assert size_for_images(data) == size
    for recipe in (digits, digits_paper):
        views = "known" if key == "images" else "predicted"
        assert generator_size(recipe(data=data, views=views, channels=16)) == size
        assert generator_size(recipe(data=data, views=views, channels=16, size=16)) == 16


@pytest.mark.parametrize("content", [None, b"", b"PK\x03\x04 cut", b"text"])
def test_damaged_lines_are_left_to_the_reader(tmp_path: Path, content: bytes | None) -> None:
    if content is not None:
        (tmp_path / "scans.npz").write_bytes(content)
    assert detectors_of(tmp_path / "scans.npz") is None and size_for_images(tmp_path / "scans.npz") == 32
    assert size_for_images(None) == 32


@pytest.mark.parametrize("recipe", ["shapes", "shapes-paper"])
@pytest.mark.parametrize("size", [0, -5, 8, 24, 5000])
def test_sizes_at_which_shapes_cannot_be_learned_are_refused(recipe: str, size: int) -> None:
    with pytest.raises(UserError, match=f"--size {size}: shapes are learned at 16, 32, 64, 128, 256 voxels a side"):
        find(recipe)(size=size, steps=1)
