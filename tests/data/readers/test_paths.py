"""Which reader a folder is for, and what lies in it that is not looked for."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from unproject._files import paths_below
from unproject._types import UserError
from unproject.data import Collection, read
from unproject.data.readers.probes import find_probes


def mesh(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    trimesh.creation.box().export(folder / "model.obj")
    return folder


def picture(file: Path) -> Path:
    file.parent.mkdir(parents=True, exist_ok=True)
    Image.new("L", (8, 8), 255).save(file)
    return file


def test_pictures_beneath_a_shape_are_its_textures(tmp_path: Path) -> None:
    for name in "ab":
        picture(mesh(tmp_path / name) / "images" / "texture.png")
    assert read(tmp_path, size=8).names == ("a/model.obj", "b/model.obj")


@pytest.mark.parametrize("hidden", [".thumbs/a.png", ".a.png"])
def test_hidden_pictures_are_none(tmp_path: Path, hidden: str) -> None:
    mesh(tmp_path / "a")
    picture(tmp_path / hidden)
    assert read(tmp_path, size=8).names == ("a/model.obj",)


@pytest.mark.parametrize("place", ["mask.png", "masks/mask.png"])
def test_shapes_and_other_pictures_are_not_mixed(tmp_path: Path, place: str) -> None:
    mesh(tmp_path / "a")
    picture(tmp_path / place)
    with pytest.raises(UserError, match=r"holds shapes \(.*model.obj\) and pictures \(.*mask.png\); name a folder"):
        read(tmp_path, size=8)


def test_linked_folders_are_looked_through_once(tmp_path: Path) -> None:
    own, other = tmp_path / "own", picture(tmp_path / "other" / "a.png").parent
    own.mkdir()
    (own / "link").symlink_to(other)
    (own / "again").symlink_to(other)
    (own / "around").symlink_to(own)
    assert [path.relative_to(own).as_posix() for path in paths_below(own)] == ["again", "again/a.png"]


def test_arrays_of_truth_values_are_averaged_as_images(tmp_path: Path) -> None:
    """Not thresholded again."""
    mask = np.zeros((1, 8, 8), bool)
    mask[:, :, :3] = True
    np.savez(tmp_path / "masks.npz", masks=mask)
    np.save(tmp_path / "masks.npy", mask)
    for name in ("masks.npz", "masks.npy"):
        found = read(tmp_path / name, 4, pictures="images").floats()
        assert torch.allclose(found[0, 0, 0], torch.tensor([1.0, 0.5, 0.0, 0.0]), atol=0.003), name


SKIPPED = {
    "pictures/a.png": lambda folder: Collection.images(folder / "pictures", 8).skipped,
    "top/a.png": lambda folder: Collection.photographs(folder, "top", 8).skipped,
    "shapes/a.obj": lambda folder: read(folder / "shapes", size=8).skipped,
    "probes/a.npy": lambda folder: find_probes(folder / "probes").skipped,
}
"""Of each kind of file, how a folder is read."""


@pytest.mark.parametrize("name", SKIPPED)
def test_links_whose_file_is_gone_are_named_and_pipes_not_waited_for(name: str, tmp_path: Path) -> None:
    """As of a disk that is not there: what lies on it would be missing without a word."""
    good = tmp_path / name
    good.parent.mkdir()
    if good.suffix == ".png":
        Image.fromarray(np.arange(64, dtype=np.uint8).reshape(8, 8)).save(good)
    elif good.suffix == ".npy":
        np.save(good, np.ones((8, 16, 3), np.float32))
    else:
        trimesh.creation.box().export(good)
    good.with_stem("gone").symlink_to(tmp_path / "elsewhere")
    os.mkfifo(good.with_stem("pipe"))
    ((skipped, reason),) = SKIPPED[name](tmp_path)
    assert "gone" in skipped and ("no such file" in reason.lower())
