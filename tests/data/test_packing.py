"""Packs: what a folder is read as, in one file, whatever interrupts its packing."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from unproject._types import UserError
from unproject.cli import main
from unproject.data import Collection, ReadOptions, mapped, pack, picture_count, read, side_of
from unproject.data import packing as packing_module
from unproject.data.lazy import Lazy
from unproject.data.readers import archives

COUNT = 10


def draw(folder: Path, count: int = COUNT) -> Path:
    """Boxes of different sizes."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        picture = np.zeros((40, 48), np.uint8)
        picture[4 : 14 + number % 20, 6:20] = 255
        Image.fromarray(picture).save(folder / f"{number:02d}.png")
    return folder


@pytest.fixture
def masks(tmp_path: Path) -> Path:
    folder = draw(tmp_path / "masks")
    (folder / "03.png").write_bytes(b"no picture")
    return folder


@pytest.fixture(params=[0, 2**24], ids=["mapped", "read"])
def _of_any_size(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archives, "MAPPED", request.param)


@pytest.mark.usefixtures("_of_any_size")
def test_a_pack_holds_what_the_folder_is_read_as(masks: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing_module, "FILES_PER_PART", 4)
    rows = [f"{n:02d}.png,{10 * n + 720 * (n == 5)}" for n in range(COUNT)]  # turntables count on
    (masks / "views.csv").write_text("\n".join(["file,azimuth", *rows]), encoding="utf-8")
    done: list[tuple[int, int]] = []
    made = pack(masks, masks.parent / "p.npz", ReadOptions(16), lambda *files: done.append(files))
    packed, folder = Collection.silhouettes(made.path), Collection.silhouettes(masks, 16)
    assert isinstance(packed.stored, Lazy) == (archives.MAPPED == 0)
    assert torch.equal(packed.items, folder.items) and packed.items.dtype == torch.uint8 and packed.white == 255
    assert packed.names == folder.names and packed.skipped == folder.skipped == made.skipped
    assert packed.latents is not None and folder.latents is not None
    turned = (folder.latents["azimuth"] - packed.latents["azimuth"]) / (2 * math.pi)
    assert torch.allclose(turned, turned.round(), atol=1e-6) and turned.sum() == pytest.approx(2)
    assert done[0] == (0, COUNT) and done[-1] == (COUNT, COUNT) and (made.count, made.shape) == (9, (1, 16, 16))
    assert (side_of(made.path), side_of(masks)) == (16, 40)  # of what it holds: no more can be learned from it
    assert picture_count(made.path) == picture_count(masks) == COUNT
    assert [file.name for file in masks.parent.iterdir() if file.name.startswith(".")] == []


@pytest.mark.usefixtures("_of_any_size")
@pytest.mark.parametrize("size", [None, 16, 24])
def test_images_and_other_sizes_are_made_by_the_batch(masks: Path, size: int | None) -> None:
    made = pack(masks, masks.parent / "p.npz", ReadOptions(size, images=True))
    packed, folder = Collection.images(made.path), Collection.images(masks, size)
    assert torch.equal(packed.items, folder.items) and packed.names == folder.names
    np.savez_compressed(masks.parent / "eager.npz", images=packed.items.numpy())
    rows = torch.tensor([4, 4, 1])
    for pictures in ("silhouettes", "images"):
        found, eager = (read(masks.parent / name, 8, pictures=pictures) for name in ("p.npz", "eager.npz"))
        assert torch.equal(found.items, eager.items) and found.white == eager.white
        assert torch.equal(found.batch(rows), eager.batch(rows))
        assert torch.equal(found.subset([4, 1]).batch([0, 0, 1]), eager.batch(rows))
        halved, dark = mapped(found, lambda x: x / 2), mapped(eager, lambda x: x / 2)
        assert torch.equal(halved.batch(rows), dark.batch(rows)) and torch.equal(halved.items, dark.items)


def test_pictures_of_16_bits_stay_floats(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packing_module, "FILES_PER_PART", 1)
    Image.fromarray(np.full((9, 9), 51, np.uint8)).save(tmp_path / "a.png")
    Image.fromarray(np.full((9, 9), 257, np.uint16)).save(tmp_path / "b.png")
    made = pack(tmp_path, tmp_path / "out" / "p.npz", ReadOptions(images=True))
    found = Collection.images(made.path)
    assert found.items.dtype == torch.float32
    assert found.items.amax((1, 2, 3)).tolist() == pytest.approx([0.2, 257 / 65535])


def test_a_pack_belongs_to_its_files_and_to_how_they_were_read(masks: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = masks.parent / "p.npz"
    monkeypatch.setattr(packing_module, "FILES_PER_PART", 4)
    monkeypatch.setattr(packing_module, "_pack_of", lambda *_: (_ for _ in ()).throw(KeyboardInterrupt))
    with pytest.raises(KeyboardInterrupt):
        pack(masks, out, ReadOptions(16))
    assert len(list(masks.parent.glob(".p.npz.*.parts/*.npz"))) == 3 and not out.exists()
    monkeypatch.undo()
    monkeypatch.setattr(packing_module, "FILES_PER_PART", 4)
    (masks / "00.png").unlink()
    assert pack(masks, out, ReadOptions(16)).count == 8
    assert pack(masks, out, ReadOptions(24)).shape == (1, 24, 24)


def test_a_part_is_written_whole_or_not_at_all(masks: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def cut_off(file: Path, **arrays: np.ndarray) -> None:
        file.write_bytes(b"half of it")
        raise OSError("no space left")

    monkeypatch.setattr(packing_module.np, "savez", cut_off)
    with pytest.raises(OSError, match="no space left"):
        pack(masks, masks.parent / "p.npz", ReadOptions(16))
    assert not list(masks.parent.glob(".p.npz.*.parts/*"))
    monkeypatch.undo()
    assert pack(masks, masks.parent / "p.npz", ReadOptions(16)).count == COUNT - 1


@pytest.mark.parametrize("seed", [0])
def test_a_pack_that_was_killed_at_ten_instants_is_that_of_one_that_was_not(
    tmp_path: Path, seed: int, forked: None
) -> None:
    folder = draw(tmp_path / "masks", 60)
    command = [sys.executable, str(Path(__file__).with_name("killed_packs.py"))]
    done = subprocess.run(
        [*command, str(folder), str(tmp_path / "p.npz"), str(seed)], capture_output=True, text=True, check=True
    )
    there = [int(line) for line in done.stdout.split()]
    assert len(there) >= 10 and any(0 < count < 15 for count in there), "some kills came amid the parts"
    whole = (tmp_path / "whole.npz").read_bytes()
    killed = sorted(tmp_path.glob("killed-*.npz"))
    assert killed and all(pack.read_bytes() == whole for pack in killed)
    assert not list(tmp_path.glob(".*")), "nothing is left beside them"


def test_a_link_whose_file_is_gone_is_skipped_as_in_its_folder(masks: Path) -> None:
    (masks / "11.png").symlink_to("elsewhere")
    made = pack(masks, masks.parent / "p.npz", ReadOptions(16))
    assert made.skipped == Collection.silhouettes(masks, 16).skipped
    assert [name for name, _ in made.skipped] == ["03.png", "11.png"]


def no_picture(folder: Path) -> None:
    for file in folder.glob("*.png"):
        file.write_bytes(b"no picture")


def no_sizes(folder: Path) -> None:
    Image.fromarray(np.zeros((9, 9), np.uint8)).save(folder / "00.png")


@pytest.mark.parametrize(
    ("change", "how", "message"),
    [
        (no_picture, ReadOptions(16), "none of the 10 pictures can be used"),
        (no_sizes, ReadOptions(images=True), "pictures are of different sizes"),
        (lambda folder: None, ReadOptions(16, strict=True), r"03\.png: unreadable.*leave out --strict"),
        (lambda folder: None, ReadOptions(2), "a size of 2 is out of range"),
    ],
    ids=["no-picture", "sizes", "strict", "size"],
)
def test_what_cannot_be_packed(masks: Path, change: object, how: ReadOptions, message: str) -> None:
    assert callable(change)
    change(masks)
    with pytest.raises(UserError, match=message):
        pack(masks, masks.parent / "p.npz", how)
    assert not (masks.parent / "p.npz").exists()


def test_nothing_is_left_of_pictures_of_which_none_can_be_used(masks: Path) -> None:
    no_picture(masks)
    with pytest.raises(UserError, match="none of the 10"):
        pack(masks, masks.parent / "p.npz", ReadOptions(16))
    assert [file.name for file in masks.parent.iterdir()] == ["masks"]


def test_a_pack_is_an_npz(masks: Path) -> None:
    with pytest.raises(UserError, match=r"p\.npy: a pack is an \.npz"):
        pack(masks, masks.parent / "p.npy", ReadOptions(16))


def test_names_that_are_no_text_and_names_with_brackets(masks: Path) -> None:
    (masks / "00.png").rename(masks / os.fsdecode(b"\xff.png"))
    out = masks.parent / "p[1].npz"
    assert pack(masks, out, ReadOptions(16)).count == COUNT - 1
    assert [file.name for file in masks.parent.iterdir() if file.name.startswith(".")] == []


def test_names_of_skipped_files_are_printed_as_one_line(masks: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (masks / "a\nunproject: b.png").write_bytes(b"no picture")
    assert main(["data", "pack", str(masks), "--out", str(masks.parent / "p.npz")]) == 0
    said = capsys.readouterr().out.splitlines()
    assert any(line.startswith("skipped a") for line in said) and not any(line.startswith("unproject") for line in said)


@pytest.mark.parametrize("action", ["pack", "inspect"])
def test_a_recipe_that_is_not_there_is_refused(masks: Path, action: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["data", action, str(masks), "--for", "digts", "--size", "28"]) == 2
    assert "digts" in capsys.readouterr().err and not list(masks.parent.glob("*.npz"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in folders")
def test_a_pipe_is_not_replaced(masks: Path, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.npz")
    with pytest.raises(UserError, match="device; give the name of a file"):
        pack(masks, tmp_path / "pipe.npz", ReadOptions(16))
    assert [path.name for path in tmp_path.glob("*.npz")] == ["pipe.npz"]


def test_arrays_beside_a_folder_are_replaced_only_if_they_are_named(
    masks: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """my_masks.npz of one's own beside my_masks/; a pack of before is made anew."""
    own = masks.with_name("masks.npz")
    np.savez(own, masks=np.ones((2, 8, 8), bool))
    before = own.read_bytes()
    assert main(["data", "pack", str(masks)]) == 2
    assert "masks.npz: is there and is no pack; name another file by --out" in capsys.readouterr().err
    assert own.read_bytes() == before
    own.write_bytes(before[:-40])
    assert main(["data", "pack", str(masks)]) == 2 and own.read_bytes() == before[:-40]
    assert main(["data", "pack", str(masks), "--out", str(own)]) == 0 == main(["data", "pack", str(masks)])
    assert picture_count(own) == COUNT


def test_a_folder_in_the_place_of_a_pack_is_refused_before_anything_is_read(masks: Path) -> None:
    (masks.parent / "p.npz").mkdir()
    with pytest.raises(UserError, match=r"p\.npz: is a folder; give --out the name of a file"):
        pack(masks, masks.parent / "p.npz", ReadOptions(16))
    assert sorted(file.name for file in masks.parent.iterdir()) == ["masks", "p.npz"]
