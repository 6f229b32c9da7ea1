"""`unproject export` on an .npz of `unproject sample`; runs have their own tests."""

from __future__ import annotations

import json
import os
import re
from types import SimpleNamespace

import docstring_parser
import numpy as np
import pytest
import trimesh
from PIL import Image

from unproject import export
from unproject.cli import main
from unproject.cli.export import run
from unproject.data import wood
from unproject.domains import Images, Maps, Volumes


@pytest.fixture
def samples(tmp_path):
    v = np.zeros((3, 8, 8, 8), np.float32)
    v[:2, 2:6, 1:7, 2:6] = 1
    np.savez_compressed(tmp_path / "samples.npz", volume=v)
    return tmp_path / "samples.npz"


def test_the_formats_are_those_of_the_package():
    (text,) = [p.description for p in docstring_parser.parse(run.__doc__).params if p.arg_name == "to"]
    formats = {**Volumes().exporters, **Maps().exporters, **Images().exporters}
    assert [name for name in formats if name not in re.findall(r"\w+", text)] == []


@pytest.mark.parametrize("to", export.MATERIAL_FORMATS)
def test_maps_are_written_as_each_format_of_materials(tmp_path, capsys, to):
    maps = {
        name: np.full((2, c, 4, 4), 0.5, np.float32) for name, c in (("diffuse", 3), ("specular", 1), ("roughness", 1))
    }
    normal = np.zeros((2, 3, 4, 4), np.float32)
    normal[:, 2] = 1
    np.savez(tmp_path / "maps.npz", **maps, normal=normal)
    assert main(["export", str(tmp_path / "maps.npz"), "--to", to, "--out", str(tmp_path / "out")]) == 0
    assert capsys.readouterr().out.startswith("wrote ")
    assert main(["export", str(tmp_path / "maps.npz"), "--to", to, "--hull", "--out", str(tmp_path / "no")]) == 2
    wanted = {"maps": "basecolor.png", "mtlx": "material.mtlx", "gltf": "*.glb"}[to]
    assert list((tmp_path / "out").rglob(wanted))


@pytest.mark.parametrize("meant", ["eta", "albedo"])
def test_arrays_keep_what_their_specular_map_means(tmp_path, capsys, meant):
    np.savez(tmp_path / "a.npz", **Maps(fresnel=meant).arrays(wood(2, 16)))
    assert main(["export", str(tmp_path / "a.npz"), "--to", "npz", "--out", str(tmp_path / "b.npz")]) == 0
    with np.load(tmp_path / "b.npz") as arrays:
        assert str(arrays["fresnel"]) == meant


@pytest.mark.parametrize(
    "given, to, says",
    [
        ("samples", ["--to", "glb", "--depth", "16"], "--depth 16: is of materials (maps, mtlx, gltf)"),
        ("samples", ["--to", "obj", "--eta", "1.3"], "--eta 1.3: is of materials"),
        ("maps", ["--to", "npz", "--fresnel", "albedo"], "--fresnel albedo: is of materials"),
        ("maps", ["--to", "mtlx", "--eta", "1.3"], "--eta 1.3: the specular map is the reflectance; add --fresnel eta"),
        ("samples", ["--to", "glb", "--coloured-specular"], "--coloured-specular: is for folders of textures"),
        ("maps", ["--to", "maps", "--coloured-specular"], "--coloured-specular: "),
    ],
)
def test_options_without_effect_are_refused(tmp_path, samples, capsys, given, to, says):
    np.savez(tmp_path / "maps.npz", **Maps(fresnel="albedo").arrays(wood(1, 16)))
    assert main(["export", str(tmp_path / f"{given}.npz"), *to, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"unproject: {says}") and error.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_an_index_is_taken_where_the_specular_map_scales_a_reflectance(tmp_path):
    np.savez(tmp_path / "maps.npz", **Maps(fresnel="eta").arrays(wood(1, 16)))
    words = ["export", str(tmp_path / "maps.npz"), "--to", "maps", "--eta", "1.3", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    assert json.loads((tmp_path / "out" / "material.json").read_text())["eta"] == 1.3


def test_a_folder_in_the_way_is_met_before_anything_is_written(tmp_path, capsys):
    np.savez(tmp_path / "a.npz", **Maps().arrays(wood(1, 16)))
    words = ["export", str(tmp_path / "a.npz"), "--to", "maps", "--out", str(tmp_path / "out")]
    assert main(words) == 0
    (tmp_path / "out" / "normal.png").unlink()
    (tmp_path / "out" / "normal.png").mkdir()
    before = {file: file.stat().st_mtime_ns for file in (tmp_path / "out").iterdir()}
    assert main(words) == 2
    assert "normal.png: is a folder where a file is to be written" in capsys.readouterr().err
    assert {file: file.stat().st_mtime_ns for file in (tmp_path / "out").iterdir()} == before


@pytest.mark.parametrize("to", export.FORMATS)
def test_every_format_is_written(samples, tmp_path, capsys, to):
    assert main(["export", str(samples), "--to", to, "--n", "1", "--out", str(tmp_path / "out")]) == 0
    assert os.listdir(tmp_path / "out") and "wrote" in capsys.readouterr().out


@pytest.mark.parametrize("to", export.FORMATS)
def test_a_file_is_written_in_the_format_of_its_name(samples, tmp_path, to):
    assert main(["export", str(samples), "--n", "1", "--out", str(tmp_path / f"out.{to.upper()}")]) == 0
    assert main(["export", str(samples), "--n", "1", "--to", to, "--out", str(tmp_path / f"same.{to}")]) == 0
    if to != "npz":  # an archive holds the time
        assert (tmp_path / f"out.{to.upper()}").read_bytes() == (tmp_path / f"same.{to}").read_bytes()


def test_a_plane_with_a_material_is_written_by_the_name_of_its_file(tmp_path):
    np.savez(tmp_path / "a.npz", **Maps().arrays(wood(1, 16)))
    assert main(["export", str(tmp_path / "a.npz"), "--out", str(tmp_path / "wood.glb")]) == 0
    assert (tmp_path / "wood.glb").read_bytes().startswith(b"glTF")


@pytest.mark.parametrize(("to", "file"), [("maps", "material.json"), ("mtlx", "material.mtlx")])
def test_chosen_materials_keep_their_numbers_and_leave_the_others(tmp_path, recwarn, to, file):
    np.savez(tmp_path / "x.npz", **Maps().arrays(wood(4, 16)))
    words = ["export", str(tmp_path / "x.npz"), "--to", to, "--out"]
    assert main([*words, str(tmp_path / "all")]) == 0
    before = {path: path.read_bytes() for path in (tmp_path / "all").rglob("*.*")}
    assert main([*words, str(tmp_path / "all"), "--only", "3", "1"]) == 0
    assert {path: path.read_bytes() for path in (tmp_path / "all").rglob("*.*")} == before
    assert not recwarn.list
    assert main([*words, str(tmp_path / "two"), "--only", "3", "1"]) == 0
    assert sorted(os.listdir(tmp_path / "two")) == ["material-01", "material-03"]
    assert main([*words, str(tmp_path / "one"), "--only", "3"]) == 0
    assert (tmp_path / "one" / file).is_file()


def test_chosen_planes_are_called_by_their_numbers(tmp_path):
    np.savez(tmp_path / "x.npz", **Maps().arrays(wood(4, 16)))
    assert main(["export", str(tmp_path / "x.npz"), "--only", "3", "1", "--out", str(tmp_path / "a.glb")]) == 0
    content = (tmp_path / "a.glb").read_bytes()
    tree = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
    assert [node["name"] for node in tree["nodes"]] == ["material-03", "material-01"]


def test_rows_of_chosen_materials_are_called_by_their_numbers(tmp_path):
    np.savez(tmp_path / "x.npz", **Maps().arrays(wood(4, 16)))
    for out, only in (("all", []), ("one", ["--only", "3"]), ("first", ["--only", "0"])):
        assert main(["export", str(tmp_path / "x.npz"), *only, "--out", str(tmp_path / f"{out}.png")]) == 0
    every, one, first = (np.asarray(Image.open(tmp_path / f"{name}.png")) for name in ("all", "one", "first"))
    label = one.shape[0] - (every.shape[0] - one.shape[0]) // 3
    assert np.array_equal(one[label:], every[-(one.shape[0] - label) :])  # its row, with its number
    assert np.array_equal(first, every[: len(first)]) and not np.array_equal(first[:, :14], one[:, :14])


def test_some_samples_are_chosen_by_their_numbers(tmp_path, capsys):
    v = np.zeros((4, 8, 8, 8), np.float32)
    for number in range(4):
        v[number, 2:6, 1 : 3 + number, 2:6] = 1
    np.savez(tmp_path / "x.npz", volume=v)
    words = ["export", str(tmp_path / "x.npz"), "--only", "3", "1"]
    assert main([*words, "--out", str(tmp_path / "meshes")]) == 0
    assert sorted(os.listdir(tmp_path / "meshes")) == ["shape_01.glb", "shape_03.glb"]
    assert main([*words, "--out", str(tmp_path / "y.npz")]) == 0
    with np.load(tmp_path / "y.npz") as arrays:
        assert np.array_equal(arrays["volume"], v[[3, 1]])
    for wrong, said in (("4", "--only 4: there are 4 samples, from 0 to 3"), ("1 1", "give each once"), ("-1", "none")):
        capsys.readouterr()
        assert main(["export", str(tmp_path / "x.npz"), "--only", *wrong.split(), "--out", str(tmp_path / "no")]) == 2
        assert (said if wrong != "-1" else "unproject: ") in capsys.readouterr().err
    assert main([*words, "--out", str(tmp_path / "chosen.png")]) == 0
    assert main(["export", str(tmp_path / "y.npz"), "--out", str(tmp_path / "anew.png")]) == 0
    chosen, anew = (np.asarray(Image.open(tmp_path / f"{name}.png"), int) for name in ("chosen", "anew"))
    assert chosen.shape == anew.shape and (chosen != anew).any()  # the numbers
    assert main([*words, "--n", "3", "--out", str(tmp_path / "no")]) == 2
    assert "samples have the numbers 0 to 2" in capsys.readouterr().err and not (tmp_path / "no").exists()


def test_meshes_are_one_surface_unless_all_parts_are_asked_for(tmp_path):
    """Blocks that share a corner are one part of the volume, and two surfaces."""
    v = np.zeros((1, 24, 24, 24), np.float32)
    v[0, 2:12, 2:12, 2:12] = v[0, 12:18, 12:18, 12:18] = 1
    v[0, 20:22, 2:4, 2:4] = 1  # under 2 % of the largest
    np.savez(tmp_path / "x.npz", volume=v)
    counts = []
    for flags in ([], ["--no-largest-part"]):
        assert main(["export", str(tmp_path / "x.npz"), *flags, "--out", str(tmp_path / "x.glb")]) == 0
        counts.append(trimesh.load(tmp_path / "x.glb", force="mesh").body_count)
    assert counts == [1, 3]


def test_empty_shapes_are_named_and_the_rest_written(samples, tmp_path, capsys):
    assert main(["export", str(samples), "--out", str(tmp_path / "scene.glb"), "--faces", "40"]) == 0
    assert "skipped shape_02: shape_02 is empty" in capsys.readouterr().out
    assert (tmp_path / "scene.glb").stat().st_size > 0


@pytest.mark.parametrize("flags, kept", [([], [64, 64]), (["--no-largest-part"], [65, 64])])
def test_parts_that_float_are_removed_unless_they_shall_stay(tmp_path, flags, kept):
    v = np.zeros((2, 8, 8, 8), np.float32)
    v[:, :4, :4, :4] = 1
    v[0, 6, 6, 6] = 1
    np.savez(tmp_path / "broken.npz", volume=v)
    words = ["export", str(tmp_path / "broken.npz"), "--to", "npz", "--out", str(tmp_path / "out.npz")]
    assert main([*words, *flags]) == 0
    with np.load(tmp_path / "out.npz") as arrays:
        assert next(iter(arrays.values())).sum((1, 2, 3)).tolist() == kept


@pytest.mark.parametrize("name, shape", [("volume", (2, 8, 8, 8)), ("image", (2, 1, 8, 8))])
def test_samples_of_bytes_are_those_of_floats(tmp_path, name, shape):
    x = np.zeros(shape, np.float32)
    x[..., 2:6, 2:6] = 1
    written = []
    for k, form in enumerate((x, x > 0, (x * 255).astype(np.uint8), x.astype(np.float64))):
        np.savez(tmp_path / "x.npz", **{name: form})
        assert main(["export", str(tmp_path / "x.npz"), "--out", str(tmp_path / f"{k}.png")]) == 0
        assert main(["export", str(tmp_path / "x.npz"), "--to", "npz", "--out", str(tmp_path / "y.npz")]) == 0
        with np.load(tmp_path / "y.npz") as arrays:
            assert np.array_equal(arrays[name], x) and arrays[name].dtype == np.float32
        written.append((tmp_path / f"{k}.png").read_bytes())
    assert len({*written}) == 1


@pytest.mark.parametrize(
    "name, values, said",
    [
        ("volume", np.full((2, 8, 8, 8), 2.0, np.float32), "values run from 2 to 2; scale pictures and volumes"),
        ("image", np.full((2, 1, 8, 8), -1.0, np.float32), "values run from -1 to -1; scale pictures and volumes"),
        ("volume", np.full((2, 8, 8, 8), np.nan, np.float32), "values that are NaN or infinite"),
        ("volume", np.ones((8, 8, 8), np.float32), "(8, 8, 8); volumes are (N, X, Y, Z) with X = Y = Z"),
        ("volume", np.ones((2, 8, 8, 6), np.float32), "(2, 8, 8, 6); volumes are (N, X, Y, Z) with X = Y = Z"),
        ("volume", np.ones((2, 8, 8, 8), np.int64), "is of type int64; save it as bool, uint8 or float32"),
        ("image", np.ones((2, 8, 8), np.float32), "(2, 8, 8); save (N, 1, H, W) or (N, 3, H, W)"),
        (
            "other",
            np.ones((2, 8, 8), np.float32),
            "holds no array 'volume'; use a file that `unproject sample` wrote\n",
        ),
    ],
)
def test_samples_that_are_none_are_refused(tmp_path, capsys, name, values, said):
    np.savez(tmp_path / "x.npz", **{name: values})
    assert main(["export", str(tmp_path / "x.npz"), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"unproject: {tmp_path / 'x.npz'}: ") and said in error and error.count("\n") == 1


@pytest.mark.parametrize("shape", [(2, 1, 8, 8), (8, 8), (1, 2, 8, 8, 8)])
def test_arrays_that_are_no_volumes_are_one_line_and_status_2(tmp_path, capsys, shape):
    np.savez(tmp_path / "x.npz", volume=np.ones(shape, np.float32))
    assert main(["export", str(tmp_path / "x.npz"), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("unproject: ") and error.count("\n") == 1


@pytest.mark.parametrize(
    "flags", [["--to", "stl"], ["--to", "vox", "--faces", "9"], ["--n", "0"], ["--faces", "1"], ["--to", "vox"]]
)
def test_mistakes_are_one_line_and_status_2(samples, tmp_path, capsys, flags):
    assert main(["export", str(samples), "--out", str(tmp_path / "out.vox"), *flags]) == 2
    error = capsys.readouterr().err
    assert error.startswith("unproject: ") and error.count("\n") == 1
    assert os.listdir(tmp_path) == ["samples.npz"]


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 cut", b"text"])
def test_a_file_of_something_else_is_one_line_and_status_2(tmp_path, capsys, content):
    (tmp_path / "x.npz").write_bytes(content)
    assert main(["export", str(tmp_path / "x.npz"), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"unproject: {tmp_path / 'x.npz'}: ") and "write or fetch it again" in error
    assert error.count("\n") == 1


def test_a_run_keeps_what_its_specular_map_means(tmp_path, capsys, monkeypatch):
    """And so does an .npz whose suffix is in capitals."""
    np.savez(tmp_path / "a.npz", **Maps(fresnel="eta").arrays(wood(1, 16)))
    (tmp_path / "a.npz").rename(tmp_path / "A.NPZ")
    out = tmp_path / "out"
    assert main(["export", str(tmp_path / "A.NPZ"), "--to", "maps", "--out", str(out)]) == 0
    assert json.loads((out / "material.json").read_text())["fresnel"] == "eta"
    opened = SimpleNamespace(domain=Maps(fresnel="eta"), sample=lambda n, seed, size: wood(n, 16))
    assert main(["export", str(tmp_path / "A.NPZ"), "--to", "npz", "--out", str(tmp_path / "B.NPZ")]) == 0
    assert (tmp_path / "B.NPZ").is_file()
    monkeypatch.setattr("unproject.training.load", lambda path, trust: opened)
    (tmp_path / "recipe.json").write_text("{}")
    words = ["export", str(tmp_path), "--n", "1", "--to", "maps", "--out", str(out)]
    assert main(words) == 0
    assert json.loads((out / "material.json").read_text())["fresnel"] == "eta"
    assert main([*words, "--fresnel", "albedo"]) == 0
    assert json.loads((out / "material.json").read_text())["fresnel"] == "albedo"


@pytest.mark.parametrize(
    "to, name, wanted",
    [
        ("glb", "chair.obj", "a name that ends in .glb, or a folder"),
        ("png", "sheet.jpg", "a name that ends in .png, or a folder"),
        ("glb", "chair.stl", "a name that ends in .glb, or a folder"),
    ],
)
def test_a_file_named_like_another_format_is_refused(samples, tmp_path, capsys, to, name, wanted):
    words = ["export", str(samples), "--n", "1", "--to", to, "--out", str(tmp_path / name)]
    assert main(words) == 2
    assert f"--to {to} writes no such file; give {wanted}" in capsys.readouterr().err
    assert not (tmp_path / name).exists()
    (tmp_path / name).mkdir()
    assert main(words) == 0


def test_the_format_is_the_domains_own_unless_it_is_said(tmp_path, capsys):
    np.savez(tmp_path / "image.npz", image=np.random.rand(2, 1, 16, 16).astype(np.float32))
    assert main(["export", str(tmp_path / "image.npz"), "--out", str(tmp_path / "a")]) == 0
    assert [file.suffix for file in (tmp_path / "a").iterdir()] == [".png"]
    for name, value in (("albedo", 90), ("roughness", 120)):
        (tmp_path / "bark").mkdir(exist_ok=True)
        Image.new("RGB", (32, 32), (value,) * 3).save(tmp_path / "bark" / f"bark_{name}.png")
    assert main(["export", str(tmp_path / "bark"), "--out", str(tmp_path / "b")]) == 0
    assert {file.suffix for file in (tmp_path / "b").rglob("*") if file.is_file()} >= {".png"}
    for to in ("png", "npz"):
        assert main(["export", str(tmp_path / "bark"), "--to", to, "--out", str(tmp_path / to)]) == 0
    (tmp_path / "empty").mkdir()
    assert main(["export", str(tmp_path / "empty"), "--out", str(tmp_path / "c")]) == 2
    assert "not a run directory" in capsys.readouterr().err


def test_formats_are_known_by_their_other_names(samples, tmp_path, capsys):
    np.savez(tmp_path / "a.npz", **Maps().arrays(wood(1, 16)))
    maps = str(tmp_path / "a.npz")
    for to, written in (("glb", "*.glb"), ("materialx", "material.mtlx")):
        assert main(["export", maps, "--to", to, "--out", str(tmp_path / to)]) == 0
        assert list((tmp_path / to).rglob(written))
    for _ in range(2):  # the second time a mesh lies beside the maps
        own = tmp_path / "materialx" / "own.glb"
        assert main(["export", str(tmp_path / "materialx"), "--to", "glb", "--out", str(own)]) == 0
    assert main(["export", str(samples), "--to", "gltf", "--n", "1", "--out", str(tmp_path / "shape.glb")]) == 0
    for source, name, wanted in (
        (maps, "a.gltf", "--to gltf writes no such file; give a name that ends in .glb"),
        (maps, "a.mtlx", "--to mtlx writes no such file; give the name of a folder"),
        (str(samples), "a.gltf", "--to glb writes no such file; give a name that ends in .glb"),
    ):
        assert main(["export", source, "--out", str(tmp_path / name)]) == 2
        assert wanted in capsys.readouterr().err
