"""Photographs sorted by their light: what is said of those that are not, and of what those that are show."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from unproject._types import UserError
from unproject.data import OBSERVATIONS, Collection, photographed, refuse_unsorted, unsorted
from unproject.data.readers.lights import ELSE, FIRST, KINDS, showing


def put(*files: Path) -> None:
    for file in files:
        file.parent.mkdir(parents=True, exist_ok=True)
        Image.new("RGB", (20, 16), (120, 90, 60)).save(file)


def refused(path: Path) -> str:
    with pytest.raises(UserError) as error:
        refuse_unsorted(path)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_of_two_spellings_of_a_light_one_is_named(tmp_path: Path) -> None:
    put(tmp_path / "flash" / "a.png", tmp_path / "Flash" / "b.png", tmp_path / "COLOURED" / "c.png")
    found = unsorted(tmp_path)
    assert [*found] == [tmp_path / "Flash" / "b.png"]
    assert f"beside it {tmp_path / 'flash'} is read; move them there" in found[tmp_path / "Flash" / "b.png"]


def test_a_flat_folder_of_photographs_is_told_where_to_put_them(tmp_path: Path) -> None:
    put(*(tmp_path / f"IMG_{k}.jpg" for k in range(3)))
    said = refused(tmp_path)
    assert said.startswith(f"{tmp_path}: holds 3 photographs and nothing says their light; put them in sub-folders")
    assert f"{tmp_path / 'daylight'} for daylight or light of a room that nobody measured" in said
    assert all(name in said for name in KINDS)


def test_sub_folders_by_something_else_are_named(tmp_path: Path) -> None:
    put(*(tmp_path / name / "a.jpg" for name in ("oak", "ash", "elm", "fir")))
    assert "holds 4 photographs in ash, elm, fir, ... and nothing says their light" in refused(tmp_path)


@pytest.mark.parametrize("name", ["oak_diffuse.png", "oak_Roughness.jpg", "oak/oak_nor_gl.png"])
def test_pictures_that_are_named_as_maps_are_left_to_their_reader(tmp_path: Path, name: str) -> None:
    put(tmp_path / "IMG_1.jpg", tmp_path / name)
    refuse_unsorted(tmp_path)


def test_what_holds_no_photographs_is_left_to_its_reader(tmp_path: Path) -> None:
    refuse_unsorted(tmp_path)
    refuse_unsorted(tmp_path / "missing")
    put(tmp_path / "flash" / "a.jpg", tmp_path / ".thumbnails" / "b.jpg")
    refuse_unsorted(tmp_path)


def test_pictures_beside_the_sub_folders_are_named_with_the_reason(tmp_path: Path) -> None:
    put(
        tmp_path / "flash" / "a.jpg", tmp_path / "loose.jpg", tmp_path / "colored" / "b.png", tmp_path / "oak" / "c.png"
    )
    found = {file.relative_to(tmp_path).as_posix(): reason for file, reason in unsorted(tmp_path).items()}
    assert [*found] == ["colored/b.png", "loose.jpg", "oak/c.png"]
    assert "names neither a map nor a light. Perhaps you meant 'coloured'" in found["colored/b.png"]
    assert found["oak/c.png"].endswith("names neither a map nor a light")
    assert str(tmp_path / "daylight") in found["loose.jpg"]
    assert photographed(tmp_path) == ("flash",)


def test_pictures_of_a_kind_that_is_not_read_are_named(tmp_path: Path) -> None:
    put(tmp_path / "flash" / "a.jpg")
    for name in ("flash/b.HEIC", "daylight/c.dng"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_bytes(b"whatever")
    found = {file.name: reason for file, reason in unsorted(tmp_path).items()}
    assert found == {
        "b.HEIC": ".HEIC is not read; save it as .jpg, .png or .tif",
        "c.dng": ".dng is not read; save it as .jpg, .png or .tif",
    }
    assert Collection.photographs(tmp_path, "flash", 16).names == ("flash/a.jpg",)
    with pytest.raises(UserError, match="holds no picture that can be read: .dng is not, save it as .jpg"):
        Collection.photographs(tmp_path, "daylight", 16)


def test_what_photographs_show_and_what_to_add() -> None:
    assert showing(["diffuse", "daylight"]) == [
        "they show the maps so far: daylight: the colours",
        "what would help most: flash/ (a flash at the camera), for most of how maps go together",
    ]
    assert "what would help most: coloured/" in showing(["flash", "ambient"])[1]
    assert "what would help most: ambient/" in showing(["coloured", "flash"])[1]
    assert "what would help most: overhead/" in showing(["ambient", "coloured", "flash"])[1]
    (only,) = showing(["lamp", "top", *FIRST])
    assert "lamp, top: the colours; flash: most of how maps go together; coloured: the relief" in only
    assert showing(["diffuse", "normal"])[0] == "without photographs nothing says how maps go together"


def test_every_kind_is_said_once() -> None:
    assert len(set(OBSERVATIONS)) == len(OBSERVATIONS) and {*FIRST} < {*KINDS} < {*OBSERVATIONS}
    assert all(name in ELSE for name in KINDS if name != "daylight")


@pytest.mark.parametrize(("name", "meant"), [("cloudy", "ambient"), ("Sunny", "daylight"), ("flsh", "flash")])
def test_names_that_people_give_to_a_light_are_understood(tmp_path: Path, name: str, meant: str) -> None:
    put(tmp_path / name / "a.jpg")
    assert f"Perhaps you meant '{meant}'" in unsorted(tmp_path)[tmp_path / name / "a.jpg"]


def test_sub_folders_are_found_in_any_case(tmp_path: Path) -> None:
    (tmp_path / "Flash").mkdir()
    pixels = np.random.default_rng(0).integers(0, 255, (32, 32, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(tmp_path / "Flash" / "a.png")
    assert photographed(tmp_path) == ("flash",) and not unsorted(tmp_path)
    assert len(Collection.photographs(tmp_path, "flash", 16)) == 1


def test_blank_photographs_are_none(tmp_path: Path) -> None:
    (tmp_path / "flash").mkdir()
    rng = np.random.default_rng(0)
    black = np.zeros((32, 32, 3))
    pictures = {"a": rng.integers(0, 255, (32, 32, 3)), "black": black, "white": black + 255}
    pictures["clear"] = np.concatenate([pictures["a"], np.zeros((32, 32, 1))], 2)
    for name, pixels in pictures.items():
        Image.fromarray(pixels.astype(np.uint8)).save(tmp_path / "flash" / f"{name}.png")
    found = Collection.photographs(tmp_path, "flash", 16)
    assert found.names == ("flash/a.png",) and len(found.skipped) == 3
    assert dict(found.skipped)["flash/white.png"] == "is white throughout; remove it"
    assert dict(found.skipped)["flash/clear.png"] == "is transparent throughout; remove it"


def test_a_sub_folder_that_is_named_by_itself_leads_to_the_one_above(tmp_path: Path) -> None:
    (tmp_path / "flash").mkdir()
    Image.fromarray(np.full((32, 32, 3), 90, np.uint8)).save(tmp_path / "flash" / "a.png")
    with pytest.raises(UserError, match=f"is what a folder of materials has as a sub-folder; name {tmp_path}"):
        refuse_unsorted(tmp_path / "flash")
