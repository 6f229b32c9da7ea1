"""Folders of maps and photographs that do not belong together."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from unproject._pictures import write_picture
from unproject._types import UserError
from unproject.data import Collection


def put(folder: Path, name: str, value: tuple[int, ...], size: tuple[int, int] = (40, 32)) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    Image.new("RGB" if len(value) == 3 else "L", size, value if len(value) == 3 else value[0]).save(folder / name)


@pytest.mark.parametrize(
    "name, value, expected",
    [
        ("diffuse", (188, 188, 0), (0.5029, 0.5029, 0.0)),  # sRGB
        ("top", (188, 51, 255), (188 / 255, 0.2, 1.0)),  # as it is
        ("grazing", (51,), (0.2, 0.2, 0.2)),
        ("roughness", (128,), ((128 / 255) ** 2,)),  # m = r²
        ("specular", (51, 51, 51), (0.2,)),
        ("normal", (255, 128, 255), (0.7058, 0.0028, 0.7084)),
    ],
)
def test_each_is_read_as_artists_store_it(tmp_path: Path, name: str, value: tuple, expected: tuple) -> None:  # type: ignore[type-arg]
    put(tmp_path / name, "a.png", value)
    put(tmp_path / name, "b.png", value)
    found = Collection.photographs(tmp_path, name, 16)
    assert found.items.shape == (2, len(expected), 16, 16)
    torch.testing.assert_close(found.items[0, :, 3, 5], torch.tensor(expected), atol=2e-3, rtol=0)


def test_a_specular_map_may_be_coloured(tmp_path: Path) -> None:
    put(tmp_path / "specular", "gold.png", (255, 196, 87))
    for coloured, expected in ((False, [538 / 765]), (True, [1, 196 / 255, 87 / 255])):
        found = Collection.photographs(tmp_path, "specular", 16, coloured=coloured).items
        assert found[0, :, 3, 5].tolist() == pytest.approx(expected, abs=1e-5)


def test_signed_normals_are_refused(tmp_path: Path) -> None:
    (tmp_path / "normal").mkdir()
    write_picture(tmp_path / "normal" / "a.exr", np.full((32, 32, 3), (-0.5, 0, 0.8), np.float32), "float")
    with pytest.raises(UserError, match="values run from -0.5; give normals as ½ \\+ ½ n"):
        Collection.photographs(tmp_path, "normal", 16)


def test_the_middle_square_is_taken(tmp_path: Path) -> None:
    picture = np.zeros((32, 64, 3), np.uint8)
    picture[:, 16:48] = 255
    (tmp_path / "top").mkdir()
    Image.fromarray(picture).save(tmp_path / "top" / "a.png")
    assert Collection.photographs(tmp_path, "top", 16).items.min() == 1


def test_bad_ones_are_named_and_skipped(tmp_path: Path) -> None:
    put(tmp_path / "normal", "good.png", (128, 128, 255))
    put(tmp_path / "normal", "black.png", (0, 0, 0))
    put(tmp_path / "normal", "tiny.png", (128, 128, 255), (4, 4))
    (tmp_path / "normal" / "text.png").write_text("no picture")
    found = Collection.photographs(tmp_path, "normal", 16)
    assert found.names == ("normal/good.png",)
    assert [name for name, _ in found.skipped] == ["normal/black.png", "normal/text.png", "normal/tiny.png"]
    assert found.skipped[0][1].startswith("is no normal map") and found.skipped[2][1].startswith("is 4 × 4 pixels")
    with pytest.raises(UserError, match="black"):
        Collection.photographs(tmp_path, "normal", 16, strict=True)
    with pytest.raises(UserError, match="leave grazing out"):
        Collection.photographs(tmp_path, "grazing", 16)
    put(tmp_path / "top", "tiny.png", (1, 1, 1), (2, 2))
    with pytest.raises(UserError, match=r"none of the 1 pictures can be used \(top/tiny.png: is 2 × 2"):
        Collection.photographs(tmp_path, "top", 16)


@pytest.mark.parametrize("name", ["diffuse", "specular", "roughness", "normal"])
def test_maps_of_floats_beyond_one_are_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    write_picture(tmp_path / name / "a.exr", np.full((32, 32, 3), (0.5, 0.5, 1.3), np.float32), "float")
    with pytest.raises(UserError, match="values run to 1.3; scale maps to"):
        Collection.photographs(tmp_path, name, 16)


def test_photographs_of_floats_are_developed(tmp_path: Path) -> None:
    (tmp_path / "top").mkdir()
    picture = np.full((32, 32, 3), (0.5, 0.25, 0.0), np.float32)
    picture[:8, :, 1] = 37  # a highlight
    write_picture(tmp_path / "top" / "a.exr", picture, "float")
    found = Collection.photographs(tmp_path, "top", 16).items[0]
    assert found[:, 12, 5].tolist() == pytest.approx([0.5 ** (1 / 2.2), 0.25 ** (1 / 2.2), 0], abs=1e-3)
    assert found[:, 2, 5].tolist() == pytest.approx([0.5 ** (1 / 2.2), 1, 0], abs=1e-3)


def test_photographs_of_floats_that_would_be_white_are_refused(tmp_path: Path) -> None:
    (tmp_path / "flash").mkdir()
    radiance = 30 * np.random.default_rng(0).random((32, 32, 3)).astype(np.float32)
    write_picture(tmp_path / "flash" / "a.exr", radiance, "float")
    with pytest.raises(UserError, match="9[67]% of its values are above 1, which is white; divide them by 29"):
        Collection.photographs(tmp_path, "flash", 16)
    write_picture(tmp_path / "flash" / "a.exr", radiance / 30, "float")
    assert Collection.photographs(tmp_path, "flash", 16).items.max() < 1
    write_picture(tmp_path / "flash" / "a.exr", radiance / 30 - 0.5, "float")
    with pytest.raises(UserError, match="[45][0-9]% of its values are negative, as no light is"):
        Collection.photographs(tmp_path, "flash", 16)


def test_a_cut_out_photograph_is_refused_and_alpha_of_maps_is_dropped(tmp_path: Path) -> None:
    round_one = np.full((40, 40, 4), 90, np.uint8)
    round_one[..., 3] = np.where(np.hypot(*(np.mgrid[:40, :40] - 19.5)) < 16, 255, 0)
    for name in ("flash", "diffuse"):
        (tmp_path / name).mkdir()
        Image.fromarray(round_one).save(tmp_path / name / "a.png")
    with pytest.raises(UserError, match="transparent in 49% of its middle square; crop it to the material"):
        Collection.photographs(tmp_path, "flash", 16)
    assert len(Collection.photographs(tmp_path, "diffuse", 16)) == 1


@pytest.mark.parametrize(
    "folder, file, value, expected",
    [
        ("normal", "Wood_Normal_DirectX.png", (128, 255, 255), (0.0028, -0.7058, 0.7084)),
        ("normal", "Wood_NormalGL.png", (128, 255, 255), (0.0028, 0.7058, 0.7084)),
        ("roughness", "wood_gloss.png", (230,), ((25 / 255) ** 2,)),
        ("roughness", "wood_arm.png", (255, 102, 0), (0.16,)),
        ("roughness", "Wood_MetallicRoughnessAO.png", (0, 102, 255), (0.16,)),
    ],
)
def test_single_maps_are_read_as_their_names_say(
    tmp_path: Path, folder: str, file: str, value: tuple[int, ...], expected: tuple[float, ...]
) -> None:
    put(tmp_path / folder, file, value)
    found = Collection.photographs(tmp_path, folder, 16).items
    torch.testing.assert_close(found[0, :, 3, 5], torch.tensor(expected), atol=3e-3, rtol=0)


def test_a_height_map_is_no_normal_map(tmp_path: Path) -> None:
    put(tmp_path / "normal", "bump.png", (200,))
    with pytest.raises(UserError, match=r"bump\.png: is no normal map"):
        Collection.photographs(tmp_path, "normal", 16)


def test_channels_that_are_not_read_may_hold_anything(tmp_path: Path) -> None:
    (tmp_path / "diffuse").mkdir()
    write_picture(tmp_path / "diffuse" / "a.exr", np.full((32, 32, 4), (0.5, 0.5, 0.5, 37), np.float32), "float")
    assert Collection.photographs(tmp_path, "diffuse", 16).items.max() == pytest.approx(0.5)
