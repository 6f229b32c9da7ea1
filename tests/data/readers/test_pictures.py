"""Folders of pictures: what is used, what is skipped and why, and the views beside them."""

from __future__ import annotations

import math
import re
import struct
import time
import unicodedata
import zlib
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from unproject import _pictures
from unproject._pictures import read_displayed
from unproject._types import UserError
from unproject.data import Collection, Framing, ReadOptions, pack, read
from unproject.data.readers.sides import picture_count, size_of_picture


def block(left: int = 20, width: int = 20) -> np.ndarray:
    picture = np.zeros((80, 80), np.uint8)
    picture[15:65, left : left + width] = 255
    return picture


def save(path: Path, picture: np.ndarray | None = None) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(block() if picture is None else picture).save(path)
    return path


def bomb(path: Path, side: int = 40000) -> None:
    """A PNG of side x side pixels that never was: header, a little data, end."""

    def chunk(kind: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    header = struct.pack(">IIBBBBB", side, side, 8, 0, 0, 0, 0)
    body = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(bytes(10**5))) + chunk(b"IEND", b"")
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + body)


def test_pictures_of_every_format_are_read_in_order_and_recursively(tmp_path):
    for name in ("b.png", "a.jpg", "sub/c.webp", "d.bmp", "e.tif", "F.PNG"):
        save(tmp_path / name)
    (tmp_path / "notes.txt").write_text("no picture")
    save(tmp_path / ".hidden.png")
    found = read(tmp_path)
    assert found.names == ("F.PNG", "a.jpg", "b.png", "d.bmp", "e.tif", "sub/c.webp")
    assert found.items.shape == (6, 1, 64, 64) and found.items.dtype == torch.uint8
    assert found.latents is None and found.skipped == () and len(found) == 6
    assert (found.floats() - found.floats()[0]).abs().max() < 0.05


def test_modes_of_pictures_agree(tmp_path):
    mask = Image.fromarray(block())
    mask.convert("1").save(tmp_path / "1.png")
    mask.convert("P").save(tmp_path / "p.png")
    mask.convert("RGB").save(tmp_path / "rgb.png")
    Image.merge("LA", (Image.new("L", (80, 80), 128), mask)).save(tmp_path / "la.png")
    Image.fromarray(block().astype(np.uint16) * 257).save(tmp_path / "deep.png")
    Image.fromarray(255 - block()).save(tmp_path / "inverse.png")
    Image.fromarray(block()).convert("CMYK").save(tmp_path / "cmyk.tif")
    found = read(tmp_path, size=32)
    assert len(found) == 7 and (found.items == found.items[:1]).all()


def test_a_segmentation_with_a_palette_is_its_labels(tmp_path):
    labels = np.zeros((40, 40), np.uint8)
    labels[10:30, 10:30], labels[9, 10:30], labels[:6, :6] = 15, 255, 255  # an object, and void: a rim, a patch
    picture = Image.fromarray(labels)
    colours = [0] * 768
    colours[45:48], colours[765:] = (192, 128, 128), (224, 224, 192)  # as Pascal VOC shows them
    picture.putpalette(colours)
    picture.save(tmp_path / "voc.png")
    mask = np.where(labels == 15, 255, 0).astype(np.uint8)
    Image.fromarray(mask).save(tmp_path / "mask.png")
    found = read(tmp_path, 32).floats()
    assert torch.equal(found[0], found[1])


def test_a_palette_is_kept_where_pictures_are_as_they_are(tmp_path: Path) -> None:
    """And where 255 is the one value beside 0, or one colour of many of a drawing."""
    values = np.zeros((40, 40), np.uint8)
    values[10:30, 16:24], values[30:32, 16:24] = 255, 3
    colours = [200] * 768
    colours[9:12], colours[765:] = (90, 60, 30), (10, 20, 30)
    for name, kept in (("few", np.where(values == 3, 255, values)), ("drawing", values)):
        (tmp_path / name).mkdir()
        picture = Image.fromarray(kept.astype(np.uint8))
        picture.putpalette(colours)
        picture.save(tmp_path / name / "a.png")
        picture.convert("RGB").save(tmp_path / name / "b.png")
        images = Collection.images(tmp_path / name, colour=True).items
        assert torch.equal(images[0], images[1]) and images[0, :, 15, 20].tolist() == [10, 20, 30]
    assert read_displayed(tmp_path / "few" / "a.png", labels=True)[15, 20].tolist() == [10, 20, 30]
    found = read(tmp_path / "few", 32).floats()
    assert torch.equal(found[0], found[1]) and 0.2 < found[0].mean() < 0.4


def test_sixteen_bits_are_shares_of_65535(tmp_path):
    Image.fromarray(np.full((8, 8), 16384, np.uint16)).save(tmp_path / "a.png")
    assert np.allclose(read_displayed(tmp_path / "a.png"), 0.25, atol=1e-4)


def test_a_photograph_is_turned_as_its_camera_says(tmp_path):
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(block()).save(tmp_path / "a.jpg", exif=exif)
    item = read(tmp_path).floats()[0, 0] > 0.5
    assert item.any(0).sum() > item.any(1).sum()


def test_bad_pictures_are_named_and_skipped(tmp_path):
    good = save(tmp_path / "good.png")
    (tmp_path / "garbage.png").write_bytes(b"these are no pixels")
    (tmp_path / "empty.png").write_bytes(b"")
    noise = np.random.default_rng(0).integers(0, 255, (200, 200), dtype=np.uint8)
    whole = save(tmp_path / "truncated.jpg", noise).read_bytes()
    (tmp_path / "truncated.jpg").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "cut.png").write_bytes(good.read_bytes()[:60])
    save(tmp_path / "black.png", np.zeros((40, 40), np.uint8))
    bomb(tmp_path / "bomb.png")
    began = time.process_time()
    found = read(tmp_path)
    assert time.process_time() - began < 5
    assert found.names == ("good.png",)
    reasons = dict(found.skipped)
    assert set(reasons) == {"garbage.png", "empty.png", "truncated.jpg", "cut.png", "black.png", "bomb.png"}
    assert "truncated" in reasons["truncated.jpg"] and "too large" in reasons["bomb.png"]
    assert reasons["black.png"].startswith("empty") and reasons["garbage.png"].startswith("unreadable")


def test_a_bomb_between_pillows_two_limits_is_refused_too(tmp_path):
    bomb(tmp_path / "bomb.png", 10000)
    save(tmp_path / "good.png")
    assert "too large" in dict(read(tmp_path).skipped)["bomb.png"]


def test_strict_names_the_first_bad_picture(tmp_path):
    save(tmp_path / "good.png")
    (tmp_path / "bad.png").write_bytes(b"x")
    with pytest.raises(UserError, match=r"bad\.png: unreadable.*--strict"):
        read(tmp_path, strict=True)


def test_missing_empty_and_hopeless_folders(tmp_path):
    with pytest.raises(UserError, match="no such file or folder; check the path"):
        read(tmp_path / "nowhere")
    with pytest.raises(UserError, match="holds no picture; put png"):
        read(tmp_path)
    (tmp_path / "a.png").write_bytes(b"x")
    with pytest.raises(UserError, match=r"none of the 1 pictures can be used \(a.png: unreadable"):
        read(tmp_path)
    with pytest.raises(UserError, match="is one picture; name the folder"):
        read(save(tmp_path / "b.png"))


def test_size_and_framing_are_obeyed(tmp_path):
    save(tmp_path / "a.png")
    found = read(str(tmp_path), size=40, framing=Framing(mode="keep"))
    assert found.items.shape == (1, 1, 40, 40)
    assert float(found.floats().mean()) == pytest.approx(block().mean() / 255, rel=1e-3)
    with pytest.raises(UserError, match="a size of 1 is out of range; give 4"):
        read(tmp_path, size=1)


def test_float_pictures_with_nan_are_skipped(tmp_path):
    values = np.full((20, 20), np.nan, np.float32)
    Image.fromarray(values).save(tmp_path / "a.tif")
    save(tmp_path / "b.png")
    assert "NaN" in dict(read(tmp_path).skipped)["a.tif"]
    assert read_displayed(tmp_path / "b.png").shape == (80, 80, 1)


@pytest.fixture
def pair(tmp_path):
    save(tmp_path / "a.png"), save(tmp_path / "sub/b.png")
    return tmp_path


def test_views_are_radians_in_the_order_of_the_pictures(pair):
    (pair / "views.csv").write_text("file, azimuth, elevation\nsub/b.png, 90, -10\n\na.png,-45.5,0\n")
    latents = read(pair).latents
    assert latents is not None and set(latents) == {"azimuth", "elevation"}
    assert latents["azimuth"].tolist() == pytest.approx([math.radians(-45.5), math.pi / 2])
    assert latents["elevation"].tolist() == pytest.approx([0, math.radians(-10)])


def test_views_of_a_skipped_picture_are_left_out(pair):
    (pair / "bad.png").write_bytes(b"x")
    (pair / "views.csv").write_text("file,azimuth\na.png,10\nbad.png,20\nsub/b.png,30\n")
    found = read(pair)
    assert found.latents is not None
    assert found.latents["azimuth"].rad2deg().tolist() == pytest.approx([10, 30])


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("file,azimuth\na.png,1\nsub/b.png,2\nc.png,3\n", r"line 4: there is no picture c\.png"),
        ("file,azimuth\na.png,1\nsub/b.png,east\n", r"line 3: 'east' is no angle"),
        ("file,azimuth\na.png,1\nsub/b.png,nan\n", r"line 3: 'nan' is no angle"),
        ("file,azimuth\na.png,1\nsub/b.png,1e300\n", r"line 3: '1e300' is no angle"),
        ("file,azimuth\na.png,1\na.png,2\nsub/b.png,2\n", r"line 3: a\.png has a row already"),
        ("file,azimuth\na.png,1,2\nsub/b.png,2\n", r"line 2: has 3 cells; give 2"),
        ("file,azimuth\na.png,1\n", r"1 pictures have no row, the first is sub/b\.png"),
        ("name,angle\na.png,1\n", r"line 1: the header is file,azimuth"),
        ("", r"line 1: the header"),
    ],
)
def test_faults_of_views_are_named_by_line(pair, table, message):
    (pair / "views.csv").write_text(table)
    with pytest.raises(UserError, match=message):
        read(pair)


def test_views_in_another_encoding(pair):
    (pair / "views.csv").write_bytes("file,azimuth\na.png,1\n".encode("utf-16"))
    with pytest.raises(UserError, match="save it as CSV in UTF-8"):
        read(pair)


def test_labels_of_large_pictures_are_not_averaged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(_pictures, "MOST_SHOWN", 1000)
    exif = Image.Exif()
    exif[274] = 6
    for name, label in (("label", 20), ("mask", 255)):
        values = np.zeros((81, 121), np.uint8)
        values[13:61, 15:90] = label
        Image.fromarray(values).save(tmp_path / f"{name}.png", exif=exif)
    found = read(tmp_path, 32)
    assert found.skipped == () and found.names == ("label.png", "mask.png")
    assert (found.floats()[0] - found.floats()[1]).abs().mean() < 0.05
    assert _pictures.read_displayed(tmp_path / "label.png").shape == (31, 21, 1)
    assert {*np.unique(_pictures.read_displayed(tmp_path / "label.png"))} == {0, 20}


def test_the_size_of_a_picture_is_that_of_the_turned_one(tmp_path: Path) -> None:
    for orientation, size in ((1, (30, 20)), (3, (30, 20)), (6, (20, 30))):
        exif = Image.Exif()
        exif[274] = orientation
        for name in ("a.jpg", "a.png", "a.tif"):
            Image.new("RGB", (30, 20)).save(tmp_path / name, exif=exif)
            assert size_of_picture(tmp_path / name) == size


def test_pictures_of_formats_that_are_not_read_are_skipped_by_name(tmp_path):
    Image.new("L", (20, 20), 255).save(tmp_path / "a.png")
    for name in ("b.HEIC", "c.gif", ".d.gif", "notes.txt", "e.jfif", "f.pgm", "g.tga"):
        (tmp_path / name).write_bytes(b"whatever")
    found = read(tmp_path, pictures="images")
    reasons = dict(found.skipped)
    assert (
        set(reasons) == {"b.HEIC", "c.gif", "e.jfif", "f.pgm", "g.tga"}
        and reasons["c.gif"] == ".gif is not read; save it as .jpg, .png or .tif"
    )
    assert dict(pack(tmp_path, tmp_path.with_suffix(".npz"), ReadOptions(images=True)).skipped) == reasons
    with pytest.raises(UserError, match=r"b.HEIC: .HEIC is not read"):
        read(tmp_path, pictures="images", strict=True)


@pytest.mark.parametrize(
    "values, said",
    [
        (np.full((80, 80), 8.0, np.float32), "values run from 8 to 8; scale them to [0, 1]"),
        (np.full((80, 80), -0.5, np.float32), "values run from -0.5 to -0.5; scale them to [0, 1]"),
        (
            np.full((80, 80), 200, np.int32),
            "holds integers of 32 bits; save them as 8 or 16 bits, or as floats in [0, 1]",
        ),
    ],
)
def test_deep_pictures_of_another_unit_are_not_clipped(tmp_path: Path, values: np.ndarray, said: str) -> None:
    Image.fromarray(values).save(tmp_path / "deep.tif")
    with pytest.raises(UserError, match=re.escape(said)):
        read(tmp_path, pictures="images")
    Image.fromarray(np.full((80, 80), 1.005, np.float32)).save(tmp_path / "deep.tif")
    assert read(tmp_path, pictures="images").floats().eq(1).all()


@pytest.mark.parametrize("suffix", ["tif", "webp", "png"])
def test_a_stack_is_not_taken_for_its_first_picture(tmp_path: Path, suffix: str) -> None:
    frames = [Image.fromarray(np.roll(block(), 9 * k, 0)) for k in range(3)]
    frames[0].save(tmp_path / f"a.{suffix}", save_all=True, append_images=frames[1:])
    save(tmp_path / "b.png")
    found = read(tmp_path)
    assert found.names == ("b.png",)
    assert found.skipped == ((f"a.{suffix}", "holds 3 frames; save each as a picture of its own"),)


def test_a_thumbnail_is_no_frame(tmp_path: Path) -> None:
    whole = Image.fromarray(block())
    whole.save(tmp_path / "a.tif", save_all=True, append_images=[whole.resize((20, 20))])
    whole.save(tmp_path / "b.tif")
    found = read(tmp_path)
    assert not found.skipped and found.items[0].equal(found.items[1])


def test_what_renderers_and_scanners_write_is_named(tmp_path: Path) -> None:
    save(tmp_path / "a.png")
    for name in ("b.exr", "c.dcm", "d.mrc"):
        (tmp_path / name).write_bytes(b"something")
    assert [name for name, _ in read(tmp_path).skipped] == ["b.exr", "c.dcm", "d.mrc"]


def test_a_folder_and_its_pack_count_the_same_pictures(tmp_path: Path) -> None:
    folder = tmp_path / "masks"
    folder.mkdir()
    save(folder / "a.png")
    (folder / "b.heic").write_bytes(b"something")
    (folder / "c.png").write_bytes(b"damaged")
    pack(folder, tmp_path / "masks.npz", ReadOptions())
    assert picture_count(folder) == picture_count(tmp_path / "masks.npz") == 2


def test_an_accent_may_be_spelt_in_two_ways(tmp_path: Path) -> None:
    save(tmp_path / unicodedata.normalize("NFD", "né.png"))
    (tmp_path / "views.csv").write_text(unicodedata.normalize("NFC", "file,azimuth\nné.png,90\n"), encoding="utf-8")
    latents = read(tmp_path).latents
    assert latents is not None and latents["azimuth"].tolist() == pytest.approx([math.pi / 2])


def test_a_table_of_views_is_found_in_any_case_and_where_it_is_read(tmp_path: Path) -> None:
    save(tmp_path / "sub" / "a.png")
    (tmp_path / "sub" / "views.csv").write_text("file,azimuth\na.png,90\n")
    with pytest.warns(UserWarning, match="sub/views.csv: is not read"):
        assert read(tmp_path).latents is None
    (tmp_path / "Views.CSV").write_text("file,azimuth\nsub/a.png,90\n")
    assert (read(tmp_path).latents or {})["azimuth"].tolist() == pytest.approx([math.pi / 2])


def test_angles_that_may_be_radians_are_said(tmp_path: Path) -> None:
    save(tmp_path / "a.png")
    save(tmp_path / "b.png")
    (tmp_path / "views.csv").write_text("file,azimuth\na.png,0.5\nb.png,6.1\n")
    with pytest.warns(UserWarning, match="no angle is beyond 6.3; they are taken for degrees, not for radians"):
        read(tmp_path)
    (tmp_path / "views.csv").write_text("file,azimuth,elevation\na.png,0.5,95\nb.png,6.1,0\n")
    with pytest.raises(UserError, match="line 2: an elevation of 95 degrees is beyond a pole"):
        read(tmp_path)


def test_the_polarity_of_close_crops_is_that_of_the_folder_and_of_its_pack(tmp_path: Path) -> None:
    folder = tmp_path / "masks"
    folder.mkdir()
    for k in range(3):
        save(folder / f"{k}.png", 255 - block())
    tight = np.full((40, 30), 255, np.uint8)
    tight[:, :12] = tight[-14:] = 0
    save(folder / "tight.png", tight)
    found = read(folder)
    assert found.floats()[-1].mean() < 0.5
    pack(folder, tmp_path / "masks.npz", ReadOptions())
    assert torch.equal(read(tmp_path / "masks.npz").floats(), found.floats())
