"""What `unproject data inspect` tells and draws of materials."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from unproject._types import UserError
from unproject.cli import main
from unproject.cli.data import inspect_path
from unproject.data import OBSERVATIONS, holds_materials, inspect_materials, wood
from unproject.data.readers.patches import side_to_cut_from
from unproject.domains import Maps
from unproject.export.pictures import _CAPTION
from unproject.ops.maps import unpack_maps
from unproject.recipes import material_panels

CELL = 2 * 64 + 4
"""Pixels of a picture on a sheet, of 64 pixels doubled, with its margin."""


def photographs(tmp_path: Path) -> Path:
    for name, colour in {"diffuse": (200, 100, 50), "normal": (128, 128, 255), "top": (20, 180, 90)}.items():
        (tmp_path / name).mkdir(parents=True)
        for k in range(3):
            Image.new("RGB", (80, 70), colour).save(tmp_path / name / f"{k}.png")
    (tmp_path / "top" / "bad.png").write_bytes(b"no picture")
    return tmp_path


@pytest.mark.parametrize("recipe", ["wood", "metal-paper"])
def test_folders_of_photographs_are_shown_in_colour_a_row_for_each(tmp_path: Path, capsys, recipe: str) -> None:
    folder = photographs(tmp_path)
    inspect_path(folder, for_=recipe, out=tmp_path / "sheet.png")
    text = capsys.readouterr().out
    assert (
        "9 used, 1 skipped" in text and "  diffuse: 3 maps; 80 x 70 pixels" in text and text.startswith("top/bad.png")
    )
    assert "  top: 3 photographs, lit by natural light of --probes, from above; 80 x 70 pixels" in text
    assert "the largest centred square is used, at 64 x 64 pixels" in text and "views" not in text
    assert "they show the maps so far: top: the colours" in text and "what would help most: flash/" in text
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.size == (8 * CELL, 3 * (CELL + _CAPTION))
        rows = [(CELL + _CAPTION) * row + _CAPTION + 66 for row in range(3)]
        tops = [sheet.getpixel((66, row)) for row in rows]
        assert sheet.getpixel((3 * CELL + 66, rows[0])) == (128, 128, 128), "no more than three"
        captions = np.asarray(sheet.convert("L"))[(CELL + _CAPTION) : (CELL + _CAPTION) + _CAPTION]
        assert (captions == 255).any() and len(np.unique(captions)) > 5
    for shown, colour in zip(tops, [(200, 100, 50), (128, 128, 255), (20, 180, 90)], strict=True):
        assert np.abs(np.subtract(shown, colour)).max() <= 3


def test_few_kinds_have_more_rows(tmp_path: Path) -> None:
    (tmp_path / "daylight").mkdir()
    for k in range(20):
        Image.new("RGB", (64, 64), (10 * k, 90, 60)).save(tmp_path / "daylight" / f"{k:02}.png")
    inspect_path(tmp_path, for_="wood", out=tmp_path / "sheet.png")
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.size == (8 * CELL, 3 * CELL + _CAPTION)


def test_a_specular_and_a_roughness_map_are_shown_grey(tmp_path: Path) -> None:
    for name in ("specular", "roughness"):
        (tmp_path / name).mkdir()
        Image.new("L", (64, 64), 128).save(tmp_path / name / "a.png")
    inspect_path(tmp_path, for_="wood", out=tmp_path / "sheet.png")
    with Image.open(tmp_path / "sheet.png") as sheet:
        specular, roughness = (sheet.getpixel((66, k * (CELL + _CAPTION) + _CAPTION + 66)) for k in range(2))
    assert specular == (186, 186, 186) and roughness == (64, 64, 64)  # γ = 2.2; m = r²


def test_pictures_that_no_observation_takes_are_named(tmp_path: Path, capsys) -> None:
    folder = photographs(tmp_path)
    (folder / "colored").mkdir()
    for file in (folder / "loose.png", folder / "colored" / "a.png"):
        Image.new("RGB", (64, 64)).save(file)
    assert main(["data", "inspect", str(folder), "--for", "wood", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert [one["name"] for one in said["skipped"]] == ["top/bad.png", "colored/a.png", "loose.png"]
    assert "Perhaps you meant 'coloured'" in said["skipped"][1]["reason"]
    assert said["for"] == "wood" and any(note.startswith("top: 3 photographs") for note in said["notes"])
    assert said["files"][0] == {"name": "diffuse/0.png", "size": "80 x 70", "read_as": "picture of diffuse"}


@pytest.mark.parametrize("command", ["train wood --data", "data inspect --for metal"])
def test_a_flat_folder_of_photographs_is_one_line_that_says_what_to_do(tmp_path: Path, capsys, command: str) -> None:
    Image.new("RGB", (64, 64)).save(tmp_path / "IMG_1.jpg")
    verb, *rest = command.split()
    words = [verb, rest[0], str(tmp_path), *rest[1:]] if verb == "data" else [verb, *rest, str(tmp_path)]
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"unproject: {tmp_path}: holds 1 photographs") and error.count("\n") == 1
    assert str(tmp_path / "daylight") in error


def textures(tmp_path: Path) -> Path:
    for name in ("oak", "ash"):
        (tmp_path / name).mkdir(parents=True)
        for role, value in {"color": (150, 90, 40), "roughness": (128, 128, 128)}.items():
            Image.new("RGB", (256, 256), value).save(tmp_path / name / f"{role}.png")
    (tmp_path / "elm").mkdir()
    Image.new("RGB", (256, 256)).save(tmp_path / "elm" / "color.png")
    return tmp_path


def test_texture_sets_are_shown_as_their_maps_and_lit(tmp_path: Path, capsys) -> None:
    inspect_path(textures(tmp_path), for_="wood", out=tmp_path / "sheet.png")
    text = capsys.readouterr().out
    assert "2 used, 1 skipped" in text and "patches: 64 of 8 x 64 x 64" in text and text.startswith("elm")
    assert "materials: 2 of 256 x 256 texels" in text
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.size == (5 * 260, 2 * (260 + _CAPTION))
        cells = [sheet.getpixel((260 * k + 130, _CAPTION + 130)) for k in range(5)]
    (red, green, blue), specular, roughness, normal, lit = cells  # type: ignore[misc]
    assert red > green > blue and specular[0] == specular[2] and roughness == (64, 64, 64)  # type: ignore[index]
    assert normal == (128, 128, 255) and lit[0] > lit[1] > lit[2] and lit != cells[0]  # type: ignore[index]


def test_the_patches_are_those_of_training(tmp_path: Path) -> None:
    found = inspect_materials(textures(tmp_path), 64)
    assert found.collections["patches"].shape == (8, 64, 64) and found.materials is not None
    assert found.materials.names == ("ash", "oak")


def test_maps_of_formats_that_are_not_read_are_named(tmp_path: Path) -> None:
    """As engines have them: a normal map that is left out makes a flat surface."""
    folder = tmp_path / "stone"
    folder.mkdir()
    for name in ("stone_BaseColor", "stone_Roughness", "stone_Normal"):
        (folder / f"{name}.tga").write_bytes(b"whatever")
    with pytest.raises(
        UserError, match=r"none of the 3 pictures .*stone_BaseColor\.tga: \.tga is not read; save it as"
    ):
        inspect_materials(tmp_path, 16)
    Image.new("RGB", (64, 64), (90, 80, 70)).save(folder / "stone_BaseColor.png")
    with pytest.raises(UserError, match=r"no roughness map, and stone_BaseColor\.tga is not read, save it as \.png"):
        inspect_materials(tmp_path, 16)
    Image.new("L", (64, 64), 90).save(folder / "stone_Roughness.png")
    found = inspect_materials(tmp_path, 16)
    assert {row.name: row.skipped for row in found.skipped}["stone/stone_Normal.tga"].startswith(".tga is not read")


def test_stray_pictures_and_enlarged_materials_are_said(tmp_path: Path, capsys) -> None:
    folder = textures(tmp_path)
    for name in ("oak/IMG_2041.png", "notes.jpg"):
        Image.new("RGB", (20, 20)).save(folder / name)
    found = inspect_materials(folder, 128)
    assert sorted(row[0] for row in found.skipped) == ["elm", "notes.jpg", "oak/IMG_2041.png"]
    assert ("oak", "256 x 256", "material", "") in found.rows
    assert "2 of them are smaller and were enlarged: ash, oak" in found.notes
    assert not any("enlarged" in note for note in inspect_materials(folder, 64).notes)


# ---------------------------------------------------------------------------------------------- what a path is for


def test_paths_that_clearly_hold_materials_need_no_recipe(tmp_path: Path, capsys) -> None:
    for folder in (photographs(tmp_path / "a"), textures(tmp_path / "b"), archive(tmp_path / "c.npz")):
        assert holds_materials(folder)
        assert main(["data", "inspect", str(folder), "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["for"] == "materials"
    inspect_path(tmp_path / "b")
    assert "read as materials, which the recipe materials learns; --for shapes" in capsys.readouterr().out
    with pytest.raises(UserError, match="none of the 10 pictures can be used"):
        inspect_path(tmp_path / "a", for_="shapes")


def test_silhouettes_are_no_materials(tmp_path: Path, capsys) -> None:
    """Nor are classes and views whose names lights have too, textures of meshes, or what is damaged."""
    mask = Image.new("L", (64, 64))
    mask.paste(255, (10, 10, 50, 50))
    for name in ("top", "side", "lamp", "chair", "normal"):
        (tmp_path / "masks" / name).mkdir(parents=True)
        mask.save(tmp_path / "masks" / name / "0.png")
    assert not holds_materials(tmp_path / "masks")
    inspect_path(tmp_path / "masks")
    assert "silhouettes: 5" in capsys.readouterr().out
    textures(tmp_path)
    assert holds_materials(tmp_path)
    (tmp_path / "oak" / "oak.obj").write_text("")
    assert not holds_materials(tmp_path)
    np.savez(tmp_path / "a.npz", volume=np.zeros((2, 8, 8, 8), bool))
    (tmp_path / "b.npz").write_bytes(b"PK broken")
    assert not any(holds_materials(tmp_path / name) for name in ("a.npz", "b.npz", "c.npz", "missing"))
    (tmp_path / "empty" / "flash").mkdir(parents=True)
    assert not holds_materials(tmp_path / "empty")


def test_framing_is_for_silhouettes(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no pixel reaches the threshold"):
        inspect_path(photographs(tmp_path), mode="crop", threshold=0.5)
    with pytest.raises(UserError, match="takes pictures as they are"):
        inspect_path(tmp_path, for_="wood", threshold=0.5)


def test_photographs_taken_for_silhouettes_are_told_of_materials(tmp_path: Path, capsys) -> None:
    picture = np.full((60, 60, 3), 230, np.uint8)
    picture[20:40, 10:30] = (60, 40, 30)
    Image.fromarray(picture).save(tmp_path / "a.jpg", quality=95)
    for name in ("b.jpg", "c.jpg"):  # nothing stands out of them, as of most surfaces
        Image.fromarray(np.full((60, 60, 3), 120, np.uint8)).save(tmp_path / name)
    inspect_path(tmp_path)
    assert "read as silhouettes of objects; --for materials" in capsys.readouterr().out
    inspect_path(tmp_path, for_="shapes")
    assert "read as silhouettes of objects" not in capsys.readouterr().out
    (tmp_path / "a.jpg").unlink()
    with pytest.raises(UserError, match="none of the 2 pictures can be used .* surfaces are read with --for materials"):
        inspect_path(tmp_path)


def archive(path: Path) -> Path:
    maps = {name: value.numpy() for name, value in unpack_maps(wood(2, 64)).items()}
    np.savez(path, fresnel="albedo", **maps)  # pyright: ignore[reportArgumentType]
    return path


def test_an_archive_of_maps_of_the_recipes_size_is_taken_as_it_is(tmp_path: Path, capsys) -> None:
    found = inspect_materials(archive(tmp_path / "a.npz"), 64)
    assert torch.equal(found.collections["materials"].items, wood(2, 64))
    inspect_path(tmp_path / "a.npz", for_="wood", out=tmp_path / "sheet.png")
    assert "materials: 2 of 64 x 64 texels" in capsys.readouterr().out
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.size == (5 * CELL, 2 * (CELL + _CAPTION))


def test_names_that_are_not_distinct_and_maps_that_are_not_square(tmp_path: Path) -> None:
    """Each has a row of its own; square patches are cut out of what is not square, in training too."""
    maps = {name: value[..., :48, :].numpy() for name, value in unpack_maps(wood(3, 64)).items()}
    np.savez(tmp_path / "a.npz", names=np.array(["a", "a", "b"]), **maps)  # pyright: ignore[reportArgumentType]
    inspect_path(tmp_path / "a.npz", for_="wood", out=tmp_path / "sheet.png")
    with Image.open(tmp_path / "sheet.png") as sheet:
        assert sheet.height == 3 * (CELL + _CAPTION)
    assert inspect_materials(tmp_path / "a.npz", 32).collections["patches"].shape == (8, 32, 32)
    found = inspect_materials(tmp_path / "a.npz", 64)
    assert found.collections["patches"].shape == (8, 64, 64) and "3 of 64 x 48 texels" in found.notes[0]
    drawn = material_panels.source_of(wood, tmp_path / "a.npz", 64, 0)
    assert drawn(material_panels.observation_of("diffuse", None, 1), 2).shape == (2, 3, 64, 64)


def test_large_patches_are_few(tmp_path: Path) -> None:
    archive(tmp_path / "a.npz")
    assert len(inspect_materials(tmp_path / "a.npz", 2048).collections["patches"]) == 4


def test_texture_sets_are_read_at_most_at_the_largest_size(tmp_path: Path) -> None:
    assert (side_to_cut_from(64), side_to_cut_from(2048)) == (256, 4096)


def test_photographs_of_a_telephone_are_explained(tmp_path: Path, capsys) -> None:
    (tmp_path / "flash").mkdir()
    (tmp_path / "flash" / "a.heic").write_bytes(b"heic")
    assert holds_materials(tmp_path)
    assert main(["data", "inspect", str(tmp_path)]) == 2
    assert "save" in capsys.readouterr().err


def test_the_recipes_read_what_is_shown() -> None:
    assert set(OBSERVATIONS) == {*material_panels.MAPS, *material_panels.VIEWED_FROM}


def test_maps_are_drawn_as_they_are_learned(tmp_path: Path) -> None:
    """Those for an index of refraction as the reflectances that they mean, darker by 25."""
    maps = wood(4, 32, 0)
    for meant in ("eta", "albedo"):
        np.savez(tmp_path / f"{meant}.npz", **Maps(fresnel=meant).arrays(maps))  # type: ignore[arg-type]
    eta, albedo = (inspect_materials(tmp_path / f"{meant}.npz", 32).materials for meant in ("eta", "albedo"))
    assert eta is not None and albedo is not None
    torch.testing.assert_close(eta.floats()[:, 3], albedo.floats()[:, 3] * 0.04)


def test_views_from_overhead_are_no_materials(tmp_path: Path) -> None:
    for name in ("front", "overhead", "side"):
        (tmp_path / name).mkdir()
        Image.new("L", (32, 32)).save(tmp_path / name / "a.png")
    assert not holds_materials(tmp_path)
