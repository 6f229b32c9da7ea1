"""What `unproject data inspect` tells and draws."""

from __future__ import annotations

import inspect as inspect_module
import json
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from unproject._types import UserError
from unproject.cli import main
from unproject.cli.data import inspect_path
from unproject.data import Collection, Framing, inspect
from unproject.recipes import find
from unproject.recipes.sizes import size_for


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    mask = np.zeros((60, 90), np.uint8)
    mask[10:50, 30:60] = 255
    Image.fromarray(mask).save(tmp_path / "a.png")
    Image.fromarray(255 - mask).save(tmp_path / "b.png")
    Image.fromarray(np.stack([mask * 0, mask * 0, mask * 0, mask], -1)).save(tmp_path / "c.png")
    (tmp_path / "d.png").write_bytes(b"broken")
    return tmp_path


def test_the_table_says_how_each_is_read_and_why_one_is_not(folder: Path) -> None:
    found = inspect(folder)
    assert [row.read_as for row in found.used] == [
        "luminance on dark background",
        "luminance on light background",
        "alpha",
    ]
    table = found.table()
    assert "90 x 60" in table and "3 used, 1 skipped" in table and "silhouettes: 3 of 1 x 64 x 64; views: unk" in table
    assert table.startswith("d.png") and "unreadable" in table.splitlines()[0]


def test_objects_in_parts_or_cut_off_are_told(tmp_path: Path) -> None:
    mask = np.zeros((60, 60), np.uint8)
    mask[10:30, 5:25] = mask[30:60, 35:55] = 255
    Image.fromarray(mask).save(tmp_path / "a.png")
    (row,) = inspect(tmp_path).rows
    assert row.read_as == "luminance on dark background, in 2 parts, cut off by the border it seems"


@pytest.mark.parametrize("strange", [2, 3])
def test_training_warns_of_many_objects_in_parts_or_cut_off(tmp_path: Path, strange: int) -> None:
    """Of twenty: two are a tenth."""
    for k in range(20):
        mask = np.zeros((60, 60), np.uint8)
        mask[10:30, 5:25] = 255
        mask[30:60, 35:55] = 255 * (k < strange)
        Image.fromarray(mask).save(tmp_path / f"{k}.png")
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        Collection.silhouettes(tmp_path, 32)
    texts = [str(one.message).partition(": ")[2].partition(",")[0] for one in told]
    several = ["3 of 20 silhouettes are in several parts", "3 of 20 silhouettes are cut off by a border"]
    assert texts == (several if strange == 3 else [])


def test_a_warning_is_printed_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Training reads a folder of silhouettes twice."""
    for k in range(20):
        mask = np.zeros((32, 32), np.uint8)
        mask[4:10, 5:25] = mask[16:28, 5:25] = 255
        Image.fromarray(mask).save(tmp_path / f"{k}.png")
    flags = "--size 16 --channels 16 --rank 8 --batch 8 --steps 1 --tries 1 --quiet"
    words = ["train", "shapes", "--data", str(tmp_path), *flags.split(), "--out", str(tmp_path / "run")]
    monkeypatch.setattr("sys.argv", ["unproject", *words])
    monkeypatch.setattr("unproject.cli.stop_with_parent", lambda: None)
    assert main() == 0
    assert capsys.readouterr().err.count("20 of 20 silhouettes are in several parts") == 1


def test_it_shows_what_training_gets(folder: Path) -> None:
    found, trained = inspect(folder, size=32).collections["silhouettes"], Collection.silhouettes(folder, 32)
    assert torch.equal(found.items, trained.items) and found.names == trained.names and found.white == trained.white


def test_views_are_named(folder: Path) -> None:
    (folder / "views.csv").write_text("file,azimuth\na.png,0\nb.png,10\nc.png,20\n")
    assert "views: azimuth" in inspect(folder).table()


def test_arrays_are_inspected_too(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", sil=np.eye(16)[None].repeat(30, 0))
    table = inspect(tmp_path / "a.npz").table(limit=5)
    assert "and 25 more" in table and "30 used, 0 skipped" in table


def test_a_framing_reaches_the_pictures(folder: Path) -> None:
    kept = inspect(folder, framing=Framing(mode="keep")).collections["silhouettes"]
    assert float(kept.floats()[0].mean()) == pytest.approx(40 * 30 / 90**2, rel=1e-2)


# ------------------------------------------------------------------------------------------------------------ the verb


@pytest.mark.parametrize("recipe", ["shapes", "shapes-paper", "digits"])
def test_the_verb_shows_the_size_that_the_recipe_takes(folder: Path, capsys, recipe: str) -> None:
    default = inspect_module.signature(find(recipe)).parameters["size"].default
    size = default or (32 if recipe == "digits" else size_for(folder))
    assert main(["data", "inspect", str(folder), "--for", recipe, "--json"]) == 0
    described = json.loads(capsys.readouterr().out)
    assert (
        described["used"] == 3
        and described["shape"] == [3, 1, size, size]
        and described["skipped"][0]["name"] == "d.png"
    )


def test_the_verb_shows_shapes_unless_told_otherwise_and_obeys_a_size(folder: Path, capsys) -> None:
    inspect_path(folder)
    assert "3 of 1 x 32 x 32" in capsys.readouterr().out
    inspect_path(folder, out=folder / "out/sheet.png", size=48)
    assert "3 used, 1 skipped" in capsys.readouterr().out
    with Image.open(folder / "out/sheet.png") as sheet:
        assert sheet.size == (3 * 96, 96)
        pixels = np.asarray(sheet.convert("L"))
    assert pixels[48, 48] == 255 and pixels[6, 6] == 0 and pixels[0, 0] == 128, "white on black, on grey"


def test_digits_are_shown_as_they_are(tmp_path: Path, capsys) -> None:
    Image.fromarray(np.tile(np.linspace(0, 255, 28).astype(np.uint8), (28, 1))).save(tmp_path / "ramp.png")
    inspect_path(tmp_path, for_="digits", out=tmp_path / "sheet/a.png")
    assert "pictures: 1 of 1 x 32 x 32" in capsys.readouterr().out
    with Image.open(tmp_path / "sheet/a.png") as sheet:
        assert len(np.unique(np.asarray(sheet.convert("L")))) > 20
    with pytest.raises(UserError, match="--for digits: takes pictures as they are"):
        inspect_path(tmp_path, for_="digits", threshold=0.5)


def test_volumes_are_not_shown_as_what_images_are_learned_from(tmp_path: Path) -> None:
    np.savez(tmp_path / "wedges.npz", volume=np.triu(np.ones((2, 32, 32, 32), np.float32)))
    with pytest.raises(UserError, match="holds volumes; digits learns images; --for shapes reads it"):
        inspect_path(tmp_path / "wedges.npz", for_="digits")


def test_lines_are_shown_as_graphs(tmp_path: Path, capsys) -> None:
    lines = np.zeros((3, 16), np.float32)
    lines[:, 4:8] = [[0.1], [0.2], [0.4]]
    np.savez(tmp_path / "scans.npz", lines=lines, angle=np.array([0.0, 0.5, 3.0]))
    inspect_path(tmp_path / "scans.npz", for_="digits", out=tmp_path / "sheet.png")
    text = capsys.readouterr().out
    assert "angle: 0.0° to 171.9°" in text and "readings: 0 to 0.4, taken as they are" in text
    assert "lines: 3 of 1 x 16; views: angle" in text and "00000  1 x 16  line" in text
    with Image.open(tmp_path / "sheet.png") as sheet:
        tile = np.asarray(sheet.convert("L"))[2:94, 2:94]
    assert (tile[:, 24:45] == 255).all() and (tile[:, :22] == 0).all() and (tile[:, 48:] == 0).all()


def test_volumes_are_shown_shaded(tmp_path: Path, capsys) -> None:
    volume = np.zeros((3, 32, 32, 32), bool)
    volume[:, 8:24, 4:28, 8:24] = True
    np.savez(tmp_path / "a.npz", volume=volume)
    inspect_path(tmp_path / "a.npz", out=tmp_path / "sheet.png")
    assert "volumes: 3 of 32 x 32 x 32" in capsys.readouterr().out
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.size == (3 * 96, 96) and len(np.unique(np.asarray(sheet))) > 5


def test_the_verb_packs_what_the_recipe_reads(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = folder.parent / "pack.npz"
    assert main(["data", "pack", str(folder), "--for", "shapes-paper", "--size", "24", "--out", str(out)]) == 0
    assert f"{out}: " in capsys.readouterr().out
    assert torch.equal(Collection.silhouettes(out).items, Collection.silhouettes(folder, 24).items)
    assert main(["data", "pack", str(folder), "--for", "digits"]) == 0
    assert Collection.images(folder.with_name(f"{folder.name}.npz")).shape == (1, 32, 32)
    assert main(["data", "pack", str(folder), "--for", "wood"]) == 2
    assert "materials are read from their folder" in capsys.readouterr().err
    assert main(["data", "pack", str(folder), "--for", "digits", "--mode", "keep"]) == 2
    assert main(["data", "pack", str(out)]) == 2
    assert "is a file; name a folder of pictures" in capsys.readouterr().err


def test_textures_are_not_packed_as_silhouettes_unless_asked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("Color", "Roughness", "NormalGL"):
        pixels = np.zeros((32, 32, 3), np.uint8)
        pixels[8:24, 8:24] = 200
        (tmp_path / "oak").mkdir(exist_ok=True)
        Image.fromarray(pixels).save(tmp_path / "oak" / f"oak_1K-PNG_{name}.png")
    assert main(["data", "pack", str(tmp_path / "oak")]) == 2
    assert "materials are read from their folder, as `train materials --data` does" in capsys.readouterr().err
    assert not (tmp_path / "oak.npz").exists()
    assert main(["data", "pack", str(tmp_path / "oak"), "--for", "shapes"]) == 0


def test_an_unknown_recipe_is_a_mistake(folder: Path) -> None:
    with pytest.raises(UserError, match="no recipe 'shaps'"):
        inspect_path(folder, for_="shaps")


def test_the_verb_shows_why_nothing_can_be_used_and_then_fails(tmp_path: Path, capsys) -> None:
    (tmp_path / "d.png").write_bytes(b"broken")
    with pytest.raises(UserError, match=r"none of the 1 pictures can be used \(d.png: unreadable"):
        inspect_path(tmp_path)
    assert "0 used, 1 skipped" in capsys.readouterr().out
    with pytest.raises(UserError, match="a contact sheet is a picture"):
        picture = Image.new("L", (40, 40))
        picture.paste(255, (10, 10, 30, 30))
        picture.save(tmp_path / "e.png")
        inspect_path(tmp_path, out=tmp_path / "sheet.txt")
    assert not capsys.readouterr().out


def test_what_outlines_say_of_cameras_counts_for_pictures_that_were_not_cropped(tmp_path: Path) -> None:
    rows, columns = np.mgrid[:64, :64]
    for k in range(3):  # diamonds: no outline is level
        mask = (np.abs(rows - 32) + np.abs(columns - 32)) < 20 + k
        Image.fromarray((255 * mask).astype(np.uint8)).save(tmp_path / f"{k}.png")
    cropped, kept = inspect(tmp_path), inspect(tmp_path, framing=Framing(mode="keep"))
    assert "but of cropped pictures shapes take it so" in cropped.summary()[-2]
    assert "shapes learn the elevation of cameras too, if pictures were not cropped" in kept.summary()[-2]


def test_how_narrow_the_narrowest_pictures_are_is_said(tmp_path: Path) -> None:
    for k, wide in enumerate([12, *[60] * 20]):
        mask = np.zeros((96, 96), np.uint8)
        mask[20:60, 10 : 10 + wide] = 255
        Image.fromarray(mask).save(tmp_path / f"{k}.png")
    found = inspect(tmp_path)
    assert found.as_dict()["narrowest"] == pytest.approx(0.3 + 0.4 * (1.5 - 0.3), abs=0.05)  # between two pictures
    assert "the narrowest pictures are 0.7" in found.summary()[-1] and "up to that" in found.summary()[-1]


def test_round_feet_are_said(tmp_path: Path) -> None:
    rows, columns = np.mgrid[:96, :96] - 48
    for k in range(4):
        cup = (np.abs(columns) < 20 + k) & (rows > -30)
        rim = 20 + 8 * np.sqrt(np.clip(1 - (columns / (20 + k)) ** 2, 0, 1))
        Image.fromarray((255 * (cup & (rows < rim))).astype(np.uint8)).save(tmp_path / f"{k}.png")
    found = inspect(tmp_path)
    assert found.summary()[-1] == (
        "  100% of pictures show a round foot: of unknown views shapes prefer bodies of revolution"
    )
    assert found.as_dict()["round_feet"] == 1.0


def test_what_is_not_read_of_an_npz_is_said_and_the_size_that_lines_are_learned_at(tmp_path: Path, capsys) -> None:
    path = tmp_path / "scans.npz"
    lines = np.random.default_rng(0).random((60, 64)).astype(np.float32)
    np.savez(path, lines=lines, theta=np.linspace(0, 3, 60), dose=np.ones((60, 2)))
    assert main(["data", "inspect", str(path), "--for", "digits"]) == 0
    said = capsys.readouterr().out
    assert "  learned as pictures of 64 x 64: see --size of train\n  not read: dose 60 x 2\n" in said
    assert main(["data", "inspect", str(path), "--for", "digits", "--size", "16", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["not_read"] == {"dose": [60, 2]}
    pictures = tmp_path / "masks.npz"
    np.savez(pictures, masks=lines.reshape(60, 8, 8) > 0.5, azimuth=np.zeros(60), theta=np.zeros(60))
    found = inspect(pictures)
    assert found.unread == {"theta": (60,)} and not any("learned as" in line for line in found.summary())


def test_a_sheet_among_the_pictures_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Image.fromarray(np.pad(np.full((20, 30), 255, np.uint8), 9)).save(tmp_path / "a.png")
    assert main(["data", "inspect", str(tmp_path), "--out", str(tmp_path / "sheet.png")]) == 0
    assert "sheet.png: lies in the folder and will be taken for data; move it" in capsys.readouterr().err


def test_pictures_that_are_the_same_are_told(tmp_path: Path) -> None:
    masks = np.zeros((12, 16, 16), np.uint8)
    masks[:, 4:12, 4:12] = 1
    np.savez(tmp_path / "same.npz", masks=masks)
    assert "  11 are the same as another one" in inspect(tmp_path / "same.npz").summary()
    for k in range(12):
        masks[k, 2, k] = 1
    np.savez(tmp_path / "others.npz", masks=masks)
    assert not any("same" in line for line in inspect(tmp_path / "others.npz").summary()[1:])
