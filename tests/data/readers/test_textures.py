"""Folders of textures become maps: by name, with the right numbers, and with one line where they cannot."""

from __future__ import annotations

import unicodedata
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from PIL import Image
from torch import Tensor

from unproject._pictures import write_picture
from unproject._types import UserError
from unproject.cli._materials import read_maps
from unproject.data import Collection, Convention, holds_materials, read_material, wood
from unproject.data.readers.texture_maps import normals_from_height
from unproject.data.readers.texture_names import find_textures, holds_material, role_of, sets_in, words_of
from unproject.domains import Maps
from unproject.ops.exposure import linear_from_srgb
from unproject.ops.maps import MAPS, luminance, unpack_maps
from unproject.recipes.material_panels import textures_of

MEASURED = Path(__file__).parents[4] / "shared" / "data" / "materials" / "svbrdf"
GREY = 128  # sRGB's middle: 0.2158605 linear
LINEAR = 0.2158605
FLAT = (128, 128, 255)
UPWARD = (128, 228, 206)  # a normal that leans to +y in the OpenGL convention
SIZE = 8


def paint(path: Path, value: Any, size: tuple[int, int] = (SIZE, SIZE), dtype: Any = np.uint8) -> Path:
    """A picture of one value (or of the array given), of 8 or 16 bits."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.asarray(value, dtype)
    pixels = pixels if pixels.ndim >= 2 else np.broadcast_to(pixels, (*size, *pixels.shape))
    if dtype is np.uint16:
        write_picture(path, pixels / 65535, "uint16")
    elif dtype is np.float32:
        write_picture(path, pixels, "float")
    else:
        Image.fromarray(np.ascontiguousarray(pixels)).save(path)
    return path


def material(folder: Path, **others: Any) -> Path:
    """A material of mid grey and half roughness; `others` are added or replace them, None leaves one out."""
    for name, value in {"color": (GREY,) * 3, "roughness": GREY, **others}.items():
        if value is not None:
            paint(folder / f"{name}.png", value)
    return folder


def maps_of(folder: Path, **options: Any) -> dict[str, Tensor]:
    return {name: value[0] for name, value in unpack_maps(read_material(folder, **options)[None]).items()}


# --------------------------------------------------------------------------------------------------------------- names


@pytest.mark.parametrize(
    "name, role",
    [
        ("Wood027_1K_Color", "colour"),
        ("Wood027_1K-JPG_Color", "colour"),
        ("wood_planks_diff_1k", "colour"),
        ("albedo", "colour"),
        ("BaseColor", "colour"),
        ("Wood_Base_Color", "colour"),
        ("Wood_Normal_Map", "normal"),
        ("WoodNormalDirectX", "normal"),
        ("Wood_Ambient_Occlusion", "unused"),
        ("chair.basecolor.4k", "colour"),
        ("Metal030_1K_Metalness", "metallic"),
        ("rusty_metal_metallic", "metallic"),
        ("painted_metal_rough_2k", "roughness"),
        ("rough_wood_diff_1k", "colour"),
        ("Planks_Roughness", "roughness"),
        ("Wood027_1K_NormalGL", "normal"),
        ("wood_nor_dx_1k", "normal"),
        ("wall NORMAL", "normal"),
        ("floor_spec_1k", "specular"),
        ("Wood027_1K_Displacement", "height"),
        ("wood_disp_1k", "height"),
        ("wood_arm_1k", "packed"),
        ("Crate_OcclusionRoughnessMetallic", "packed"),
        ("Crate_MetallicRoughness", "packed"),
        ("metallic_paint_roughness", "roughness"),
        ("MetalSheet_AO", "unused"),
        ("T_Planks_BC", "colour"),
        ("T_Planks_D", None),
        ("Wood027", None),
        ("IMG_2041", None),
    ],
)
def test_the_words_of_a_name_say_which_map_it_is(name: str, role: str | None) -> None:
    assert role_of(words_of(name)) == role


def test_words_are_split_at_signs_digits_and_capitals() -> None:
    assert words_of("Wood027_1K_NormalGL") == ["wood", "027", "1", "k", "normal", "gl"]
    assert words_of("old wood-nor.gl_4k") == ["old", "wood", "nor", "gl", "4", "k"]
    assert words_of("木材Diff_ДубDIFF") == ["木材", "diff", "дуб", "diff"]
    assert words_of(unicodedata.normalize("NFD", "HolzmöbelRough")) == ["holzmöbel", "rough"]


def lettered(folder: Path, *names: str) -> Path:
    for name in names:
        paint(folder / f"{name}.png", FLAT if "_n" in name.lower() else GREY)
    return folder


def test_a_letter_at_the_end_is_a_map_in_a_set_with_a_normal_map(tmp_path: Path) -> None:
    """Strays are left; names that say a map by a word keep it; silhouettes are no maps."""
    planks = ("T_Planks_D", "T_Planks_N_2K", "T_Planks_R_1024")
    folder = lettered(tmp_path / "a", *planks, "T_Planks_Preview", "render", "IMG_2")
    assert find_textures(folder).files.keys() == {"colour", "normal", "roughness"}
    assert {*sets_in(lettered(tmp_path / "b", *(f"{n}_{c}" for n in ("oak", "ash") for c in "dnr")))} == {"oak", "ash"}
    assert find_textures(lettered(tmp_path / "c", "rock_bc", "rock_n", "rock_orm")).files.keys() >= {"colour", "normal"}
    words = ("brick_color_s", "brick_roughness_s", "brick_normal_s")
    assert find_textures(lettered(tmp_path / "d", *words)).files.keys() == {"colour", "roughness", "normal"}
    nameless = ("图", "__", "k", "2k", "512")
    objects = (("mug0_d", "mug0_r"), ("cup_d", "cup_n", "cup_r", "cup_x"), ("n", "d", "x"), nameless)
    for k, names in enumerate(objects):
        assert not holds_material(lettered(tmp_path / f"objects{k}", *names))


def test_a_preview_named_as_the_material_is_no_metallic_map(tmp_path: Path) -> None:
    for name in ("Metal007_1K_Color", "Metal007_1K_Roughness"):
        paint(tmp_path / f"{name}.png", GREY)
    paint(tmp_path / "Metal007.png", 255)
    paint(tmp_path / "Metal007_PREVIEW.jpg", 255)
    assert maps_of(tmp_path)["specular"].max().item() == pytest.approx(0.04)
    for name in ("rusty_metal_diff_1k", "rusty_metal_rough_1k", "rusty_metal_metal_1k"):
        paint(tmp_path / "b" / f"{name}.png", 255)
    assert maps_of(tmp_path / "b")["diffuse"].max() == 0, "Poly Haven's metal map"


# --------------------------------------------------------------------------------------------------------------- values


def test_the_maps_of_a_grey_dielectric(tmp_path: Path) -> None:
    maps = maps_of(material(tmp_path))
    assert read_material(tmp_path).shape == (8, SIZE, SIZE)
    assert torch.allclose(maps["diffuse"], torch.tensor(LINEAR), atol=1e-6), "sRGB's mid grey"
    assert torch.allclose(maps["specular"], torch.tensor(0.04)), "F0 of a dielectric"
    assert torch.allclose(maps["roughness"], torch.tensor((GREY / 255) ** 2)), "m = r²"
    assert maps["normal"].flatten(1).T.tolist() == [[0, 0, 1]] * SIZE**2
    assert torch.allclose(maps_of(tmp_path, roughness="alpha")["roughness"], torch.tensor(GREY / 255))


def test_srgb_is_decoded_at_known_points() -> None:
    v = torch.tensor([0.0, 0.04, 0.5, 1.0], dtype=torch.float64)
    assert linear_from_srgb(v).tolist() == pytest.approx([0, 0.0030960, 0.2140411, 1], abs=1e-7)


def test_metal_takes_its_reflectance_from_its_colour(tmp_path: Path) -> None:
    """F0 = lerp(0.04, b, w); k_s = its luminance, k_d = b (1 - w)."""
    maps = maps_of(material(tmp_path, color=(255, 0, 0), metallic=51))
    assert maps["diffuse"][:, 0, 0].tolist() == pytest.approx([0.8, 0, 0])
    red, other = 0.8 * 0.04 + 0.2, 0.8 * 0.04
    assert maps["specular"].mean().item() == pytest.approx(0.2126 * red + 0.7874 * other, abs=1e-6)


def test_metal_keeps_its_colour_if_asked_to(tmp_path: Path) -> None:
    """F0 = lerp(0.04, b, w) itself; all else as without, and its luminance what is read without."""
    maps = maps_of(material(tmp_path, color=(255, 0, 0), metallic=51), specular="colour")
    red, other = 0.8 * 0.04 + 0.2, 0.8 * 0.04
    assert maps["specular"][:, 0, 0].tolist() == pytest.approx([red, other, other], abs=1e-6)
    plain = maps_of(tmp_path)
    assert torch.equal(luminance(maps.pop("specular")), plain.pop("specular"))
    assert all(torch.equal(value, plain[name]) for name, value in maps.items())


def test_a_coloured_specular_map_is_the_reflectance_itself(tmp_path: Path) -> None:
    """In sRGB, as specular maps of the specular-glossiness convention are; a grey one scales 0.08."""
    maps = maps_of(material(tmp_path, specular=(255, GREY, 0)), specular="colour")
    assert maps["specular"][:, 0, 0].tolist() == pytest.approx([1, LINEAR, 0], abs=1e-6)
    assert maps_of(tmp_path)["specular"].mean().item() == pytest.approx(0.2126 + 0.7152 * LINEAR, abs=1e-6)
    grey = maps_of(material(tmp_path / "grey", specular=255), specular="colour")
    assert grey["specular"].flatten(1).T.tolist() == [pytest.approx([0.08] * 3)] * SIZE**2


def test_a_specular_map_scales_the_dielectrics_reflectance(tmp_path: Path) -> None:
    assert maps_of(material(tmp_path, specular=255))["specular"].mean().item() == pytest.approx(0.08)
    assert maps_of(material(tmp_path, specular=255, metallic=255))["specular"].mean().item() == pytest.approx(LINEAR)


@pytest.mark.parametrize("name", ["specular", "Wood_REFL"])
def test_specular_and_glossiness(tmp_path: Path, name: str) -> None:
    """r = 1 - g, and F0 = s in sRGB, coloured or grey, unless a metallic map says that the convention is another."""
    folder = material(tmp_path, roughness=None, GLOSS=51, **{name: (255, GREY, 0)})
    maps = maps_of(folder, specular="colour")
    assert maps["roughness"].mean().item() == pytest.approx(0.64)
    assert maps["specular"][:, 0, 0].tolist() == pytest.approx([1, LINEAR, 0], abs=1e-6)
    assert maps_of(folder)["specular"].mean().item() == pytest.approx(0.2126 + 0.7152 * LINEAR, abs=1e-6)
    assert maps["diffuse"].mean().item() == pytest.approx(LINEAR)
    grey = material(tmp_path / "grey", roughness=None, gloss=51, **{name: GREY})
    assert maps_of(grey)["specular"].mean().item() == pytest.approx(LINEAR, abs=1e-6)
    both = maps_of(material(tmp_path / "both", roughness=None, gloss=51, metallic=0, **{name: 255}))
    assert both["specular"].mean().item() == pytest.approx(0.08)


def test_glossiness_in_alpha(tmp_path: Path) -> None:
    """As Unity and glTF pack it; roughness of its own goes first, and a picture without alpha is refused."""
    metal = maps_of(material(tmp_path / "a", roughness=None, w_MetallicSmoothness=(255, 255, 255, 51)))
    assert metal["roughness"].mean().item() == pytest.approx(0.64) and metal["diffuse"].max() == 0
    assert metal["specular"].mean().item() == pytest.approx(LINEAR, abs=1e-6)
    shiny = maps_of(material(tmp_path / "b", roughness=None, w_specularGlossiness=(255, GREY, 0, 51)))
    assert shiny["roughness"].mean().item() == pytest.approx(0.64)
    assert shiny["specular"].mean().item() == pytest.approx(0.2126 + 0.7152 * LINEAR, abs=1e-6)
    own = maps_of(material(tmp_path / "c", roughness=255, w_MetallicSmoothness=(0, 0, 0, 51)))
    assert own["roughness"].min() == 1 and own["specular"].mean().item() == pytest.approx(0.04)
    with pytest.raises(UserError, match="MetallicSmoothness.png: has no alpha, which holds the glossiness"):
        maps_of(material(tmp_path / "d", roughness=None, w_MetallicSmoothness=(255, 255, 255)))


def test_gloss_in_a_materials_name_is_no_map(tmp_path: Path) -> None:
    for name in ("HighGloss_basecolor", "HighGloss_normal", "HighGloss_render"):
        paint(tmp_path / f"{name}.png", FLAT)
    with pytest.raises(UserError, match="no roughness map"):
        maps_of(tmp_path)


def test_roughness_goes_before_glossiness(tmp_path: Path) -> None:
    """And without glossiness nobody knows what a reflection map means."""
    plain = maps_of(material(tmp_path / "plain"))
    maps = maps_of(material(tmp_path, gloss=255, gloss_2=0, reflection=255))
    assert all(torch.equal(value, plain[name]) for name, value in maps.items())


def test_arrays_whose_specular_map_is_for_an_index_are_trained_on_as_reflectances(tmp_path: Path) -> None:
    """And are compared with as such; as stored they stay for `render` and `export`, which know both."""
    x = wood(2, 16)
    for meant in ("eta", "albedo"):
        np.savez(tmp_path / f"{meant}.npz", **Maps(fresnel=meant).arrays(x))  # pyright: ignore
    stored = Collection.materials(tmp_path / "eta.npz").items
    assert torch.equal(stored, x) and torch.equal(textures_of(tmp_path / "albedo.npz", 16), x)
    for found in (textures_of(tmp_path / "eta.npz", 16), Maps().read(tmp_path / "eta.npz", 16).items):
        assert torch.allclose(found[:, 3], 0.04 * x[:, 3]) and torch.equal(found[:, 4:], x[:, 4:])
    assert torch.equal(Maps(fresnel="eta").read(tmp_path / "eta.npz", 16).items, x)


def test_an_archive_that_says_nothing_is_meant_for_an_index_of_refraction(tmp_path: Path) -> None:
    """As `render` and `export` take it."""
    x = wood(2, 16)
    np.savez(tmp_path / "a.npz", **{name: part.numpy() for name, part in unpack_maps(x).items()})  # pyright: ignore
    assert torch.allclose(textures_of(tmp_path / "a.npz", 16)[:, 3], 0.04 * x[:, 3])
    assert read_maps(tmp_path / "a.npz").fresnel == "eta"
    np.savez(tmp_path / "a.npz", fresnel="F0", **{k: part.numpy() for k, part in unpack_maps(x).items()})  # pyright: ignore
    for read in (lambda path: textures_of(path, 16), read_maps):
        with pytest.raises(UserError, match="fresnel is 'F0'; store 'eta' or 'albedo', or leave it out"):
            read(tmp_path / "a.npz")


@pytest.mark.parametrize(
    "name, value",
    [
        ("T_Wood_MetallicRoughnessAO", (0, 102, 255)),
        ("T_Wood_RoughnessMetallicAO", (102, 0, 255)),
        ("T_Wood_RoughnessMetallic", (255, 102, 0)),
        ("T_Wood_OcclusionRoughnessMetallic", (255, 102, 0)),
        ("ao_dai_RoughnessMetallic", (255, 102, 0)),
    ],
)
def test_channels_of_packed_maps_are_in_the_order_of_the_name_if_occlusion_comes_last(
    tmp_path: Path, name: str, value: tuple[int, ...]
) -> None:
    maps = maps_of(material(tmp_path, roughness=None, **{name: value}))
    assert maps["roughness"].mean().item() == pytest.approx(0.16) and maps["diffuse"].max() > 0


@pytest.mark.parametrize("colour", ["BaseColor", "Base_Color"])
@pytest.mark.parametrize("normal", ["Normal_DirectX", "NormalDirectX", "Normal_OpenGL", "Normal_Map"])
def test_sets_side_by_side_named_as_engines_name_them(tmp_path: Path, colour: str, normal: str) -> None:
    for name in ("Wood", "Stone"):
        paint(tmp_path / f"{name}_{colour}.png", GREY)
        paint(tmp_path / f"{name}_Roughness.png", 128)
        paint(tmp_path / f"{name}_{normal}.png", (128, 255, 255))
    found = Collection.materials(tmp_path)
    assert sorted(found.names) == ["Stone", "Wood"]
    assert (found.floats()[:, 6].mean() < 0) == ("DirectX" in normal) and found.floats()[:, 6].abs().min() > 0.6


@pytest.mark.parametrize("side", [256, 2048])
def test_heights_of_8_bits_have_one_relief_at_every_resolution(side: int) -> None:
    y, x = torch.meshgrid(*2 * [torch.arange(side) * 2 * torch.pi / side], indexing="ij")
    h = ((torch.sin(3 * x) + torch.sin(2 * x + 3 * y) + 2) * 63.75).round() / 255
    n = F.avg_pool2d(normals_from_height(h)[None], side // 64)[0]
    assert (n[:2] / n[2:]).square().sum(0).mean().sqrt().item() == pytest.approx(0.25, rel=0.05)


def test_packed_maps_are_occlusion_roughness_metallic(tmp_path: Path) -> None:
    folder = material(tmp_path, roughness=None, wood_arm_1k=(10, 102, 255))
    maps = maps_of(folder)
    assert maps["roughness"].mean().item() == pytest.approx(0.16) and maps["diffuse"].max() == 0
    own = maps_of(material(tmp_path, roughness=255))
    assert own["roughness"].min() == 1 and own["diffuse"].max() == 0, "a map of its own goes first"


def test_the_smoothest_surface_is_a_thousandth(tmp_path: Path) -> None:
    assert maps_of(material(tmp_path, roughness=0))["roughness"].max().item() == pytest.approx(1e-3)


def test_sixteen_bits_and_floats(tmp_path: Path) -> None:
    paint(tmp_path / "color.png", (32896,) * 3, dtype=np.uint16)
    paint(tmp_path / "rough.png", 32768, dtype=np.uint16)
    assert maps_of(tmp_path)["diffuse"].mean().item() == pytest.approx(LINEAR, abs=1e-5)
    assert maps_of(tmp_path, colour="linear")["diffuse"].mean().item() == pytest.approx(32896 / 65535, abs=1e-5)
    assert maps_of(tmp_path, roughness="alpha")["roughness"].mean().item() == pytest.approx(32768 / 65535, abs=1e-6)
    (tmp_path / "color.png").unlink()
    paint(tmp_path / "color.exr", (0.25, 0.5, 0.75), dtype=np.float32)
    for colour in ("srgb", "linear"):
        assert maps_of(tmp_path, colour=colour)["diffuse"][:, 0, 0].tolist() == [0.25, 0.5, 0.75], "floats are linear"


def test_alpha_is_dropped_and_jpegs_are_read(tmp_path: Path) -> None:
    paint(tmp_path / "color.png", (GREY, GREY, GREY, 7))
    paint(tmp_path / "roughness.jpg", (GREY,) * 3)
    maps = maps_of(tmp_path)
    assert maps["diffuse"].mean().item() == pytest.approx(LINEAR, abs=1e-6)
    assert maps["roughness"].mean().item() == pytest.approx((GREY / 255) ** 2, abs=5e-3)


# -------------------------------------------------------------------------------------------------------------- normals


@pytest.mark.parametrize(
    "name, normal, up",
    [
        ("wood_NormalGL", "auto", 1),
        ("wood_NormalDX", "auto", -1),
        ("wood_nor_gl_1k", "auto", 1),
        ("wood_nor_dx_1k", "auto", -1),
        ("normal", "auto", 1),
        ("normal", "gl", 1),
        ("normal", "dx", -1),
        ("wood_NormalDX", "gl", 1),
    ],
)
def test_green_up_or_down(tmp_path: Path, name: str, normal: str, up: int) -> None:
    n = maps_of(material(tmp_path, **{name: UPWARD}), normal=normal)["normal"]
    expected = torch.tensor([1, 201, 157]) / 255  # 2 v - 1
    expected = expected / expected.norm() * torch.tensor([1, up, 1])
    assert torch.allclose(n[:, 0, 0], expected, atol=1e-6)


def test_of_a_pair_opengl_is_taken_by_default(tmp_path: Path) -> None:
    material(tmp_path, a_NormalGL=UPWARD, a_NormalDX=(228, 128, 206))
    assert maps_of(tmp_path)["normal"][1].min() > 0.5
    assert maps_of(tmp_path, normal="dx")["normal"][0].min() > 0.5


def test_normals_that_point_inward_are_turned_outward_where_few(tmp_path: Path) -> None:
    pixels = np.broadcast_to(np.array(FLAT, np.uint8), (SIZE, SIZE, 3)).copy()
    pixels[0, 0] = (128, 204, 50)  # y = 0.6, z < 0
    n = maps_of(material(tmp_path, normal=pixels))["normal"][:, 0, 0]
    assert n[1:].tolist() == pytest.approx([0.6, 0.8], abs=1e-3)


def test_height_gives_the_normal_where_there_is_none(tmp_path: Path) -> None:
    ramp = np.tile(np.r_[0:100:10, 100:0:-10].astype(np.uint8), (20, 1))  # rises to the right, then falls; repeats
    for name in ("color", "roughness"):
        paint(tmp_path / f"{name}.png", GREY, (20, 20))
    paint(tmp_path / "disp.png", ramp)
    n = maps_of(tmp_path)["normal"]
    assert (n[0, :, 1:9] < 0).all() and (n[0, :, 11:19] > 0).all() and n[1].abs().max() < 1e-6
    slope = (n[:2] / n[2:]).square().sum(0).mean().sqrt()
    assert slope.item() == pytest.approx(0.25, rel=1e-5)
    paint(tmp_path / "normal.png", FLAT, (20, 20))
    assert maps_of(tmp_path)["normal"][2].min() > 0.999, "a normal map goes first"


def test_a_height_that_rises_up_the_picture_leans_down_it() -> None:
    h = torch.sin(torch.arange(16.0) * 2 * torch.pi / 16)[:, None].expand(16, 4)
    n = normals_from_height(h)
    assert n[1, 0].min() > 0, "here h grows with the row, which is down the picture: the normal leans up"
    assert n[0].abs().max() == 0
    assert normals_from_height(torch.ones(4, 4))[2].min() == 1


# ----------------------------------------------------------------------------------------------------------------- size


def test_maps_of_several_sizes_are_brought_to_the_largest(tmp_path: Path) -> None:
    """Decoded before, so that colours are mixed as light."""
    large = np.full((2 * SIZE, 2 * SIZE), GREY, np.uint8)
    large[:SIZE] += 20
    normal = np.broadcast_to(np.array([FLAT], np.uint8), (SIZE, SIZE, 3))
    maps = maps_of(material(tmp_path, roughness=large, normal=normal), roughness="alpha")
    assert maps["roughness"].shape == (1, 2 * SIZE, 2 * SIZE) and maps["normal"][2].min() > 0.99
    assert torch.allclose(maps["roughness"][0, :, 0], torch.tensor([GREY + 20] * SIZE + [GREY] * SIZE) / 255)
    assert torch.allclose(maps["diffuse"], torch.tensor(LINEAR), atol=1e-6)
    red = np.zeros((SIZE // 2, SIZE // 2, 3), np.uint8)
    red[:, SIZE // 4 :, 0] = 255
    mixed = maps_of(material(tmp_path / "b", specular=red))["specular"][0, 0]
    assert mixed[SIZE // 2 - 2 : SIZE // 2 + 2].tolist() == pytest.approx([0, 0.25 * 0.2126, 0.75 * 0.2126, 0.2126])


def test_sides_may_be_rounded(tmp_path: Path) -> None:
    wide = material(tmp_path, color=np.full((33, 100, 3), GREY, np.uint8), roughness=np.full((17, 50), GREY, np.uint8))
    assert read_material(wide).shape == (8, 33, 100)


def test_averages_are_taken_of_linear_values(tmp_path: Path) -> None:
    board = np.indices((SIZE, SIZE)).sum(0) % 2 * np.uint8(255)
    maps = maps_of(material(tmp_path, color=board.astype(np.uint8), roughness=board.astype(np.uint8)), size=4)
    assert torch.allclose(maps["diffuse"], torch.tensor(0.5)), "not the linear value of the mean sRGB"
    assert torch.allclose(maps["roughness"], torch.tensor(0.5005)), "the mean of m"


def test_normals_are_averaged_and_renormalised(tmp_path: Path) -> None:
    pixels = np.zeros((SIZE, SIZE, 3), np.uint8)
    pixels[:, ::2], pixels[:, 1::2] = (204, 128, 230), (51, 128, 230)
    n = maps_of(material(tmp_path, normal=pixels), size=4)["normal"]
    assert torch.allclose(n[:, 1, 1], torch.tensor([0.0, 0.0, 1.0]), atol=5e-3)
    assert (n.norm(dim=0) - 1).abs().max() < 1e-6


@pytest.mark.parametrize("size", [4, 5, 8, 16])
def test_the_centred_square_is_taken(tmp_path: Path, size: int) -> None:
    """Of a wide picture, black with a white square in its middle, only the white remains."""
    pixels = np.zeros((SIZE, 2 * SIZE), np.uint8)
    pixels[:, SIZE // 2 : 3 * SIZE // 2] = 255
    paint(tmp_path / "color.png", pixels)
    paint(tmp_path / "roughness.png", pixels)
    x = read_material(tmp_path, size)
    assert x.shape == (8, size, size) and (x[:3] - 1).abs().max() < 1e-5
    assert read_material(tmp_path).shape == (8, SIZE, 2 * SIZE)


# --------------------------------------------------------------------------------------------------------------- faults


def noisy(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (SIZE, SIZE, 3)).astype(np.uint8)


@pytest.mark.parametrize(
    "others, options, reason",
    [
        ({"color": None, "roughness": None}, {}, "holds no texture maps.*albedo.*roughness"),
        ({"color": None}, {}, "no colour map.*albedo"),
        ({"roughness": None}, {}, "no roughness map.*glossiness"),
        ({"albedo": GREY}, {}, r"albedo\.png and color\.png could both be the colour map"),
        ({"normal": FLAT, "nor_gl": FLAT}, {}, r"nor_gl\.png and normal\.png could both be the normal map"),
        ({"normal": (0, 0, 0)}, {}, r"normal\.png: is no normal map \(100 %"),
        ({"normal": (128, 128, 128)}, {}, r"normal\.png: is no normal map.*length is 0\.01"),
        ({"normal": 128}, {}, r"normal\.png: is a grey picture"),
        ({"normal": (200, 200, 200)}, {}, r"normal\.png: is no normal map but grey"),
        ({"roughness": noisy()}, {}, r"roughness\.png: is coloured.*arm"),
        ({"roughness": None, "arm": 128}, {}, r"arm\.png: is a grey picture"),
        ({"metallic": np.zeros((4, 8), np.uint8)}, {}, "metallic is 8 × 4 pixels but colour is 8 × 8"),
        ({}, {"colour": "linear"}, r"color\.png: 8 bits hold sRGB values"),
        ({}, {"colour": "adobe"}, "colour is one of srgb, linear, not 'adobe'"),
        ({}, {"roughness": "m"}, "roughness is one of perceptual, alpha"),
        ({}, {"specular": "red"}, "specular is one of luminance, colour, not 'red'"),
        ({}, {"size": 2}, "size of 2"),
    ],
)
def test_faults_are_one_line_that_says_the_mend(
    tmp_path: Path, others: dict[str, Any], options: dict[str, Any], reason: str
) -> None:
    with pytest.raises(UserError, match=reason) as error:
        read_material(material(tmp_path, **others), **options)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "name, value, reason",
    [
        ("color", (0.5, np.nan, 0.5), r"color\.exr: has values that are NaN"),
        ("color", (0.5, 2.0, 0.5), r"color\.exr: values run from 0\.5 to 2; scale"),
        ("roughness", -0.5, r"roughness\.exr: values run from -0\.5"),
        ("normal", (-0.3, 0.3, 0.9), r"normal\.exr: values run from -0\.3.*normals as ½ \+ ½ n"),
    ],
)
def test_floats_out_of_range_name_their_file(tmp_path: Path, name: str, value: Any, reason: str) -> None:
    material(tmp_path, **({name: None} if name != "normal" else {}))
    paint(tmp_path / f"{name}.exr", value, dtype=np.float32)
    with pytest.raises(UserError, match=reason):
        read_material(tmp_path)


def test_a_convention_that_is_none_is_refused() -> None:
    with pytest.raises(UserError, match="fresnel is one of stored, albedo, not 'Albedo'"):
        Convention(fresnel="Albedo")  # pyright: ignore[reportArgumentType]


@pytest.mark.parametrize("name, meant", [("diffuse", "an albedo"), ("specular", "a reflectance"), ("roughness", "a")])
def test_maps_in_the_unit_of_8_bits_are_refused(tmp_path: Path, name: str, meant: str) -> None:
    maps = {name: np.full((2, 3 if name in ("diffuse", "normal") else 1, 8, 8), 0.5, np.float32) for name in MAPS}
    maps["normal"][:, :2], maps["normal"][:, 2] = 0, 1
    np.savez(tmp_path / "right.npz", **maps)
    assert len(Collection.materials(tmp_path / "right.npz")) == 2
    np.savez(tmp_path / "wrong.npz", **{**maps, name: 255 * maps[name]})
    with pytest.raises(UserError, match=rf"wrong\.npz: {name} runs to 128, and {meant} "):
        Collection.materials(tmp_path / "wrong.npz")


def test_missing_folders_and_damaged_files_are_named(tmp_path: Path) -> None:
    for read in (read_material, lambda path: Collection.materials(path, 8)):
        with pytest.raises(UserError, match="nowhere: there is no such folder"):
            read(tmp_path / "nowhere")
    (tmp_path / "wood.zip").write_bytes(b"PK")
    with pytest.raises(UserError, match=r"wood\.zip: is a file; name a folder of texture maps"):
        Collection.materials(tmp_path / "wood.zip", 8)
    path = paint(material(tmp_path) / "normal.png", noisy())
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(UserError, match=r"normal\.png"):
        read_material(tmp_path)


# ---------------------------------------------------------------------------------------------------------- collections


def test_a_folder_of_materials_at_any_depth(tmp_path: Path) -> None:
    material(tmp_path / "wood" / "oak" / "textures")
    material(tmp_path / "metal" / "iron", metallic=255)
    material(tmp_path / ".cache" / "old")
    paint(tmp_path / "wood" / "oak" / "preview.png", noisy())
    found = Collection.materials(tmp_path, 4)
    x = found.items
    assert found.names == ("metal/iron", "wood/oak/textures") and x.shape == (2, 8, 4, 4)
    assert x[0, :3].max() == 0 and x[1, :3].min() > 0
    assert Collection.materials(tmp_path / "metal" / "iron", 4).names == ("iron",)


def test_a_bad_material_is_named_and_skipped_unless_strict(tmp_path: Path) -> None:
    material(tmp_path / "good")
    material(tmp_path / "bad", roughness=None)
    paint(tmp_path / "worse" / "IMG_2041.png", 3)
    with pytest.warns(UserWarning, match="2 of 3 skipped, the first: .*bad: has no roughness"):
        found = Collection.materials(tmp_path, 4).warn_skipped()
    assert found.names == ("good",)
    assert [name for name, _ in found.skipped] == ["bad", "worse"]
    with pytest.raises(UserError, match="bad: has no roughness"):
        Collection.materials(tmp_path, 4, strict=True)
    material(tmp_path / "good", roughness=noisy())
    with pytest.raises(UserError, match="none of the 3 materials"):
        Collection.materials(tmp_path, 4)


def test_materials_stay_as_stored_if_they_are_of_one_size(tmp_path: Path) -> None:
    material(tmp_path / "a")
    assert Collection.materials(tmp_path).items.shape == (1, 8, SIZE, SIZE)
    for name in ("color", "roughness"):
        paint(tmp_path / "b" / f"{name}.png", GREY, (SIZE, 2 * SIZE))
    with pytest.raises(UserError, match="a is 8 × 8 pixels and b 16 × 8; give a size"):
        Collection.materials(tmp_path)


def arrays(count: int | None = 2) -> dict[str, np.ndarray]:
    """Maps as `unproject sample` writes them."""
    lead = () if count is None else (count,)
    made = {"diffuse": (3, 0.3), "specular": (1, 0.04), "roughness": (1, 0.2), "normal": (3, 0.0)}
    maps = {name: np.full((*lead, channels, SIZE, SIZE), value, np.float32) for name, (channels, value) in made.items()}
    maps["normal"][..., 2, :, :] = 1
    return maps


@pytest.mark.parametrize("count", [2, None])
def test_an_archive_of_maps_is_taken_as_it_is(tmp_path: Path, count: int | None) -> None:
    np.savez(tmp_path / "a.npz", **arrays(count))  # pyright: ignore[reportArgumentType]
    found = Collection.materials(tmp_path / "a.npz", 4)
    x = found.items
    assert x.shape == (count or 1, 8, 4, 4) and found.names == ("00000", "00001")[: count or 1]
    assert x[0, :, 0, 0].tolist() == pytest.approx([0.3] * 3 + [0.04, 0.2, 0, 0, 1])


def test_an_archive_may_have_three_specular_channels(tmp_path: Path) -> None:
    coloured = np.broadcast_to(np.array([1, 0.77, 0.34], np.float32)[:, None, None], (2, 3, SIZE, SIZE))
    np.savez(tmp_path / "a.npz", **{**arrays(), "specular": coloured})  # pyright: ignore[reportArgumentType]
    for size in (SIZE, 4):
        x = Collection.materials(tmp_path / "a.npz", size).items
        assert x.shape == (2, 10, size, size)
        assert x[0, :, 0, 0].tolist() == pytest.approx([0.3] * 3 + [1, 0.77, 0.34, 0.2, 0, 0, 1])


@pytest.mark.parametrize(
    "changed, reason",
    [
        ({"diffuse": np.full((2, 3, 8, 8), 99, np.uint8)}, "diffuse holds uint8 values, which would be read as linear"),
        ({"specular": None}, r"a\.npz: maps: specular missing"),
        ({"roughness": np.zeros((2, 1, 8, 8), np.float32)}, "roughness is 0"),
        ({"diffuse": np.ones((0, 3, 8, 8), np.float32)}, r"diffuse is of shape \(0, 3, 8, 8\)"),
        ({"roughness": np.ones((8, 8), np.float32)}, r"roughness is of shape \(8, 8\)"),
        ({"specular": np.ones((2, 2, 8, 8), np.float32)}, r"'specular': give \(N, 1, H, W\), or \(N, 3, H, W\) if"),
        ({"normal": np.zeros((2, 3, 8, 8), np.float32)}, "unit length"),
        ({"names": np.array(["one"])}, r"names \(1,\) for 2 materials"),
    ],
)
def test_bad_archives_say_why(tmp_path: Path, changed: dict[str, Any], reason: str) -> None:
    held = {name: value for name, value in {**arrays(), **changed}.items() if value is not None}
    np.savez(tmp_path / "a.npz", **held)
    with pytest.raises(UserError, match=reason):
        Collection.materials(tmp_path / "a.npz", 4)


@pytest.mark.skipif(not MEASURED.is_dir(), reason="the measured materials are not beside this checkout")
def test_a_measured_wood_and_a_metal() -> None:
    wood, metal = read_material(MEASURED / "wood" / "Wood027", 16), read_material(MEASURED / "metal" / "Metal032", 16)
    assert wood[3].max() < 0.0401 < 0.2 < metal[3].min(), "wood is no metal"
    assert wood[0].mean() > wood[2].mean() and metal[:3].max() < 0.05


def side_by_side(folder: Path, pattern: str, names: tuple[str, ...]) -> None:
    for k, name in enumerate(names):
        for word, value in (("diff", (60 + 60 * k,) * 3), ("rough", GREY), ("nor_gl", FLAT), ("ao", 250)):
            paint(folder / f"{pattern.format(name, word)}.png", value)


@pytest.mark.parametrize(
    ("pattern", "names", "called"),
    [
        ("{}_{}_1k", ("moss", "stone"), ("moss", "stone")),
        ("painted_metal_{}-{}", ("a", "b"), ("painted_metal_a", "painted_metal_b")),
        ("{1}{0}", ("1", "2"), ("1", "2")),
        ("wall_{1}_{0}", ("1k", "2k"), ("wall_1_k", "wall_2_k")),
    ],
)
def test_sets_that_lie_side_by_side_are_materials_each(
    tmp_path: Path, pattern: str, names: tuple[str, ...], called: tuple[str, ...]
) -> None:
    side_by_side(tmp_path / "many", pattern, names)
    paint(tmp_path / "many" / "all_preview.png", GREY)
    found = Collection.materials(tmp_path / "many")
    assert tuple(sorted(found.names)) == called
    dark, light = (unpack_maps(found.floats())["diffuse"][found.names.index(name)].mean() for name in called)
    assert dark < light
    assert holds_materials(tmp_path)
    inner = Collection.materials(tmp_path)
    assert tuple(sorted(inner.names)) == tuple(f"many/{name}" for name in called)


def test_maps_of_one_material_in_two_resolutions_stay_one(tmp_path: Path) -> None:
    for name, value in (("wood_diff_2k", (GREY,) * 3), ("wood_rough_1k", GREY)):
        paint(tmp_path / f"{name}.png", value)
    assert sets_in(tmp_path) == {} and len(Collection.materials(tmp_path)) == 1


def test_sets_whose_names_are_of_other_scripts_are_several(tmp_path: Path) -> None:
    for name in ("木材", "石材"):
        paint(tmp_path / f"{name}_diff.png", GREY)
        paint(tmp_path / f"{name}_rough.png", 128)
    assert len(Collection.materials(tmp_path)) == 2
