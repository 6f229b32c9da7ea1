"""`unproject render`: pictures, linear radiance, strips; and one line for every mistake."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from unproject._pictures import read_stored
from unproject.cli import main


@pytest.fixture
def maps(tmp_path: Path) -> Path:
    """White paper, without N, as one material may be stored."""
    path = tmp_path / "maps.npz"
    np.savez(path, **arrays())  # pyright: ignore[reportArgumentType]
    return path


def arrays(n: int = 0, size: int = 12) -> dict[str, np.ndarray]:
    lead = (n,) if n else ()
    made = {
        name: np.ones((*lead, c, size, size), np.float32)
        for name, c in (("diffuse", 3), ("specular", 1), ("roughness", 1))
    }
    made["specular"] *= 0
    made["roughness"] *= 0.4
    made["normal"] = np.zeros((*lead, 3, size, size), np.float32)
    made["normal"][..., 2, :, :] = 1
    return made


def render(*arguments: object) -> int:
    return main(["render", *map(str, arguments)])


def test_white_paper_is_one(maps: Path, tmp_path: Path) -> None:
    """A directional light that faces it and ambient light, linear radiance (H, W, 3)."""
    for light in ("directional:0,0", "ambient"):
        assert render(maps, "--view", 30, "--light", light, "--out", tmp_path / "a.npy") == 0
        radiance = np.load(tmp_path / "a.npy")
        assert radiance.shape == (12, 12, 3) and radiance.dtype == np.float32
        np.testing.assert_allclose(radiance, 1, atol=1e-2)
        assert radiance.mean() == pytest.approx(1, abs=1e-3)
    for light in ("directional:60", "coloured:60,30"):
        assert render(maps, "--light", light, "--out", tmp_path / "a.npy") == 0
        np.testing.assert_allclose(np.load(tmp_path / "a.npy"), 0.5, atol=1e-4)


def test_pictures_and_strips(maps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert render(maps, "--samples", 32, "--out", tmp_path / "a.png") == 0
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == (12, 12) and picture.mode == "RGB"
    assert (
        render(
            maps, "--view", "60,-90", "--strip", 5, "--light", "env:sky", "--samples", 8, "--out", tmp_path / "s.png"
        )
        == 0
    )
    with Image.open(tmp_path / "s.png") as picture:
        assert picture.size == (60, 12)
    assert render(maps, "--strip", 4, "--light", "directional:45", "--out", tmp_path / "s.gif") == 0
    with Image.open(tmp_path / "s.gif") as picture:
        assert getattr(picture, "n_frames", 1) >= 1 and picture.size == (12, 12)
    assert "s.gif: 4 pictures of 12×12" in capsys.readouterr().out


def test_photographs_are_no_materials_to_render(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("flash", "coloured"):
        (tmp_path / "photos" / name).mkdir(parents=True)
        Image.new("RGB", (16, 16), (120, 90, 60)).save(tmp_path / "photos" / name / "a.png")
    assert main(["render", str(tmp_path / "photos"), "--out", str(tmp_path / "a.png")]) == 2
    said = capsys.readouterr().err
    assert "photos: holds pictures by what they show (flash, coloured), no materials; `unproject train" in said


def test_textures_of_gold_are_golden_if_asked_for(tmp_path: Path) -> None:
    """Rendered and exported; without the flag they have gold's luminance."""
    gold = tmp_path / "gold"
    gold.mkdir()
    Image.new("RGB", (16, 16), (255, 226, 157)).save(gold / "color.png")
    for name, value in (("metallic", 255), ("roughness", 128)):
        Image.new("L", (16, 16), value).save(gold / f"{name}.png")
    for flags, wanted in (((), ()), (("--coloured-specular",), (1, 0.76, 0.337))):
        out = tmp_path / f"{len(flags)}"
        assert render(gold, "--light", "directional:0", "--out", f"{out}.npy", *flags) == 0
        red, _, blue = np.load(f"{out}.npy")[8, 8]
        assert red / blue == pytest.approx(1 / 0.337 if wanted else 1, rel=0.02)
        assert main(["export", str(gold), "--to", "maps", "--depth", "float", "--out", str(out), *flags]) == 0
        stored = read_stored(out / "specular.exr").pixels[0, 0]
        assert stored.tolist() == pytest.approx(wanted or [0.7805], abs=0.005)
        about = json.loads((out / "material.json").read_text(encoding="utf-8"))["maps"]["specular"]
        assert ("primaries" in about) == bool(wanted)


def test_several_materials_and_what_they_say_of_themselves(tmp_path: Path) -> None:
    many = arrays(3)
    many["diffuse"] *= 0
    many["specular"] += 1
    for fresnel, expected in (("albedo", 1.0), ("eta", 0.04)):
        np.savez(tmp_path / "many.npz", **many, fresnel=fresnel)  # pyright: ignore[reportArgumentType]
        assert render(tmp_path / "many.npz", "--light", "ambient", "--samples", 512, "--out", tmp_path / "a.npy") == 0
        seen = np.load(tmp_path / "a.npy")
        assert seen.shape == (3, 12, 12, 3)
        assert seen.mean() == pytest.approx(expected, rel=0.05)
    assert render(tmp_path / "many.npz", "--fresnel", "albedo", "--light", "ambient", "--out", tmp_path / "a.npy") == 0
    assert np.load(tmp_path / "a.npy").mean() == pytest.approx(1.0, rel=0.05)


def test_the_same_seed_is_the_same_picture_and_a_file_of_light_is_read(maps: Path, tmp_path: Path) -> None:
    light = np.random.default_rng(0).random((8, 16, 3)).astype(np.float32)
    np.save(tmp_path / "probe.npy", light)
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        lit = f"env:{tmp_path / 'probe.npy'}"
        assert render(maps, "--light", lit, "--samples", 16, "--seed", seed, "--out", tmp_path / f"{name}.npy") == 0
    a, b, c = (np.load(tmp_path / f"{name}.npy") for name in "abc")
    assert np.array_equal(a, b) and not np.array_equal(a, c)


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--light", "moon"], "--light moon"),
        (["--light", "env:moon"], "there is no such light"),
        (["--light", "env:missing.hdr"], "missing.hdr"),
        (["--light", "directional:x"], "directional:45,90"),
        (["--view", "95"], "camera must be above the material"),
        (["--light", "directional:90"], "light must be above the material"),
        (["--view", "1,2,3"], "--view 1,2,3"),
        (["--samples", "1"], "samples"),
        (["--eta", "-1"], "eta"),
        (["--strip", "0"], "--strip"),
        (["--fresnel", "none"], "fresnel"),
        (["--distance", "0"], "distance"),
        (["--repeat"], "--repeat: is of --space image"),
        (["--eta", "1.3", "--fresnel", "albedo"], "--eta 1.3: the specular map is the reflectance"),
    ],
)
def test_a_mistake_is_one_line(
    maps: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert render(maps, *arguments, "--out", tmp_path / "a.png") == 2
    error = capsys.readouterr().err
    assert error.startswith("unproject: ") and error.count("\n") == 1 and words in error
    assert not (tmp_path / "a.png").exists()


def test_a_run_is_no_material_and_what_makes_one_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "recipe.json").write_text("{}")
    assert render(tmp_path, "--out", tmp_path / "a.png") == 2
    assert f"is a run; `unproject sample {tmp_path} --out materials.npz`" in capsys.readouterr().err


def test_a_wrong_suffix_and_maps_that_cannot_be(tmp_path: Path, maps: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert render(maps, "--out", tmp_path / "a.jpg") == 2
    assert render(maps, "--out", tmp_path / "a.gif") == 2
    eight_bits = arrays()
    eight_bits["diffuse"] = (eight_bits["diffuse"] * 255).astype(np.uint8)
    np.savez(tmp_path / "bad.npz", **eight_bits)  # pyright: ignore[reportArgumentType]
    assert render(tmp_path / "bad.npz", "--out", tmp_path / "a.png") == 2
    flat = arrays()
    flat["normal"] *= 0
    np.savez(tmp_path / "flat.npz", **flat)  # pyright: ignore[reportArgumentType]
    assert render(tmp_path / "flat.npz", "--out", tmp_path / "a.png") == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4 and all(line.startswith("unproject: ") for line in lines)
    assert "linear" in lines[2] and "unit length" in lines[3]
