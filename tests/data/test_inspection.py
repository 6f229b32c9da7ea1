"""What `unproject data inspect` tells and draws."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from unproject._types import UserError
from unproject.cli.data import run
from unproject.data import Collection, Framing, contact_sheet, inspect


@pytest.fixture
def folder(tmp_path):
    mask = np.zeros((60, 90), np.uint8)
    mask[10:50, 30:60] = 255
    Image.fromarray(mask).save(tmp_path / "a.png")
    Image.fromarray(255 - mask).save(tmp_path / "b.png")
    Image.fromarray(np.stack([mask * 0, mask * 0, mask * 0, mask], -1)).save(tmp_path / "c.png")
    (tmp_path / "d.png").write_bytes(b"broken")
    return tmp_path


def test_the_table_says_how_each_is_read_and_why_one_is_not(folder):
    found = inspect(folder)
    assert [row[2] for row in found.rows if row[3] == "used"] == [
        "luminance on dark background",
        "luminance on light background",
        "alpha",
    ]
    table = found.table()
    assert "90 x 60" in table and "3 used, 1 skipped" in table and "1 x 64 x 64; views: unknown" in table
    assert table.startswith("d.png") and "unreadable" in table.splitlines()[0]


def test_it_shows_what_training_gets(folder):
    found, trained = inspect(folder, size=32), Collection(folder, size=32)
    assert found.collection is not None and torch.equal(found.collection.items, trained.items)
    assert found.collection.names == trained.names


def test_views_are_told(folder):
    (folder / "views.csv").write_text("file,azimuth\na.png,0\nb.png,10\nc.png,20\n")
    assert "views: azimuth" in inspect(folder).table()


def test_arrays_are_inspected_too(tmp_path):
    np.savez(tmp_path / "a.npz", sil=np.eye(16)[None].repeat(30, 0))
    table = inspect(tmp_path / "a.npz").table(limit=5)
    assert "and 25 more" in table and "30 used, 0 skipped" in table


def test_the_sheet_shows_the_items_side_by_side():
    items = torch.zeros(3, 1, 20, 20)
    items[1] = 1
    sheet = np.asarray(contact_sheet(Collection(items), columns=2, cell=24))
    assert sheet.shape == (48, 48)
    assert (sheet[2:22, 26:46] == 255).all() and (sheet[2:22, 2:22] == 0).all() and sheet[40, 40] == 128


def test_the_sheet_takes_64_spread_over_all_and_stands_volumes_upright():
    items = torch.arange(200).float()[:, None, None, None].expand(-1, 1, 4, 4) / 199
    sheet = contact_sheet(Collection(items), cell=8)
    assert sheet.size == (64, 64) and sheet.getpixel((60, 60)) == 255 and sheet.getpixel((4, 4)) == 0
    volume = torch.zeros(1, 8, 8, 8)
    volume[0, 0, 7] = 1
    picture = np.asarray(contact_sheet(Collection(volume), cell=12))[2:10, 2:10]
    assert picture[0, 0] == 255 and picture.astype(int).sum() == 255


def test_the_verb_prints_a_table_and_writes_a_sheet(folder, capsys):
    run("inspect", folder, out=folder / "out/sheet.png", size=32)
    assert "3 used, 1 skipped" in capsys.readouterr().out
    with Image.open(folder / "out/sheet.png") as sheet:
        assert sheet.size == (3 * 96, 96)


def test_the_verb_prints_json(folder, capsys):
    run("inspect", folder, json=True)
    told = json.loads(capsys.readouterr().out)
    assert told["used"] == 3 and told["shape"] == [3, 1, 64, 64] and told["skipped"][0]["name"] == "d.png"


def test_the_verb_shows_why_nothing_can_be_used_and_then_fails(tmp_path, capsys):
    (tmp_path / "d.png").write_bytes(b"broken")
    with pytest.raises(UserError, match=r"none of the 1 pictures can be used \(d.png: unreadable"):
        run("inspect", tmp_path)
    assert "0 used, 1 skipped" in capsys.readouterr().out
    with pytest.raises(UserError, match="a contact sheet is a picture"):
        Image.new("L", (40, 40)).save(tmp_path / "black.png")
        picture = Image.new("L", (40, 40))
        picture.paste(255, (10, 10, 30, 30))
        picture.save(tmp_path / "e.png")
        run("inspect", tmp_path, out=tmp_path / "sheet.txt")


def test_a_framing_reaches_the_pictures(folder):
    kept = inspect(folder, framing=Framing(mode="keep")).collection
    assert kept is not None and float(kept.items[0].mean()) == pytest.approx(40 * 30 / 90**2, rel=1e-4)


def test_lines_are_shown_as_graphs(tmp_path: Path) -> None:
    lines = np.zeros((3, 16), np.float32)
    lines[:, 4:8] = [[0.1], [0.2], [0.4]]
    np.savez(tmp_path / "scans.npz", lines=lines, angle=np.zeros(3))
    found = inspect(tmp_path / "scans.npz")
    assert found.rows[0] == ("00000", "1 x 16", "line", "used") and "views: angle" in found.table()
    assert found.collection is not None
    tile = np.asarray(contact_sheet(found.collection, cell=20))[2:18, 2:18]
    assert (tile[:, 4:8] == 255).all() and tile.sum() == 255 * 4 * 16
