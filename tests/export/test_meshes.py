"""Meshes: closed, right side out, right side up, in the volume's units, and valid to outside validators."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from unproject import export
from unproject._types import UserError

GLTF = Path(__file__).parents[1] / "gltf"


def block(low, high, n=24):
    v = np.zeros((n, n, n), np.float32)
    v[tuple(slice(a, b) for a, b in zip(low, high, strict=True))] = 1
    return v


def ell(n=24):
    """A tall post on the left at the back, and a low foot that reaches right and another that reaches the viewer."""
    post = block((4, 2, 4), (8, 22, 8), n)
    return np.maximum(post, np.maximum(block((4, 2, 4), (21, 6, 8), n), block((4, 2, 4), (8, 6, 14), n)))


def ball(n=24, r=0.7):
    c = (np.arange(n) + 0.5) / n * 2 - 1
    d = np.linalg.norm(np.stack(np.meshgrid(c, c, c, indexing="ij")), axis=0)
    return np.clip((r - d) / (2 / n) + 0.5, 0, 1).astype(np.float32)


def reload(path):
    with open(path, "rb") as file:
        return trimesh.load(file, file_type=Path(path).suffix[1:], force="mesh", process=False)


def validated(path):
    node = shutil.which("node")
    if node is None or not (GLTF / "node_modules" / "gltf-validator").is_dir():
        pytest.skip("the glTF validator needs node and `npm ci` in tests/gltf")
    report = subprocess.run([node, GLTF / "validate.mjs", path], capture_output=True, text=True, check=True)
    return json.loads(report.stdout)


def test_a_ball_is_closed_outwards_and_of_its_size():
    surface = export.mesh(ball())
    assert surface.is_watertight and surface.is_winding_consistent
    assert surface.volume == pytest.approx(4 / 3 * np.pi * 0.7**3, rel=0.03)
    assert (surface.vertices * surface.vertex_normals).sum(1).min() > 0


def test_a_block_is_of_its_size():
    surface = export.mesh(block((3, 3, 3), (21, 15, 9)), smooth=0)
    np.testing.assert_allclose(surface.extents, [1.5, 1.0, 0.5], atol=4e-3)
    assert surface.volume == pytest.approx(0.75, rel=0.03)


@pytest.mark.parametrize("suffix", ["glb", "obj", "ply"])
def test_after_reloading_up_is_y_right_is_x_and_the_viewer_is_at_z(tmp_path, suffix):
    path = tmp_path / f"ell.{suffix}"
    export.write(ell(), suffix, path, smooth=0)
    surface = reload(path)
    assert surface.is_watertight and surface.volume > 0
    np.testing.assert_allclose(surface.bounds, [[-8 / 12, -10 / 12, -8 / 12], [9 / 12, 10 / 12, 2 / 12]], atol=4e-3)
    top = surface.vertices[surface.vertices[:, 1] > 0]
    assert top[:, 0].max() < -0.3 and top[:, 2].max() < -0.3
    np.testing.assert_allclose(surface.vertices, export.mesh(ell(), smooth=0).vertices, atol=1e-6)


def test_the_official_validator_finds_no_fault(tmp_path):
    volumes = np.stack([ball(), ell(), block((0, 0, 0), (24, 24, 24)), np.random.default_rng(0).random((24, 24, 24))])
    export.glb(volumes, tmp_path / "scene.glb")
    issues = validated(tmp_path / "scene.glb")["issues"]
    assert (issues["numErrors"], issues["numWarnings"]) == (0, 0), issues["messages"][:3]


def test_the_validator_does_find_faults(tmp_path):
    export.glb(ball(), tmp_path / "ball.glb")
    broken = (tmp_path / "ball.glb").read_bytes().replace(b'"POSITION":', b'"POSITIOM":')
    (tmp_path / "broken.glb").write_bytes(broken)
    assert validated(tmp_path / "broken.glb")["issues"]["numErrors"] > 0


def test_one_scene_has_a_node_for_each_shape_and_they_do_not_touch(tmp_path):
    written = export.glb(torch.ones(5, 8, 8, 8), tmp_path / "five.glb", names=["a", "b", "c", "d", "e"])
    assert written.paths == (tmp_path / "five.glb",) and written.skipped == ()
    with open(written.paths[0], "rb") as file:
        scene = trimesh.load(file, file_type="glb")
    assert set(scene.graph.nodes_geometry) == {"a", "b", "c", "d", "e"}
    places = np.array([scene.graph[n][0][:3, 3] for n in sorted(scene.graph.nodes_geometry)])
    assert np.abs(places[:, 1]).max() == 0
    distances = np.abs(places[:, None] - places[None]).max(-1) + 9 * np.eye(5)
    assert distances.min() > 2
    material = scene.geometry["a"].visual.material
    assert material.metallicFactor == 0 and material.roughnessFactor > 0.5


def test_a_folder_gets_a_file_for_each_shape_and_empty_ones_are_reported(tmp_path):
    volumes = np.stack([ball(), np.zeros_like(ball()), ell()])
    written = export.glb(volumes, tmp_path / "meshes")
    assert [p.name for p in written.paths] == ["shape_00.glb", "shape_02.glb"]
    assert sorted(os.listdir(tmp_path / "meshes")) == ["shape_00.glb", "shape_02.glb"]
    assert [name for name, _ in written.skipped] == ["shape_01"]
    assert "empty" in written.skipped[0][1]


def test_nothing_at_all_to_write_is_an_error_and_leaves_no_file(tmp_path):
    with pytest.raises(UserError, match="shape_00 is empty"):
        export.glb(np.zeros((8, 8, 8)), tmp_path / "x.glb")
    with pytest.raises(UserError, match="all 3 shapes"):
        export.obj(np.zeros((3, 8, 8, 8)), tmp_path / "x")
    assert os.listdir(tmp_path) == []


def test_decimation_keeps_the_budget_and_the_mesh_closed():
    full, small = export.mesh(ball(32)), export.mesh(ball(32), faces=600)
    assert len(full.faces) > 2000 and len(small.faces) <= 600
    assert small.is_watertight and small.volume == pytest.approx(full.volume, rel=0.03)


def test_decimation_that_would_open_the_mesh_is_refused(monkeypatch):
    import fast_simplification

    full = export.mesh(ball())
    monkeypatch.setattr(fast_simplification, "simplify", lambda points, faces, **_: (points, faces[: len(faces) // 2]))
    with pytest.warns(UserWarning, match=f"the bowl keeps {len(full.faces)} triangles: no smaller closed mesh"):
        assert len(export.mesh(ball(), faces=100, name="the bowl").faces) == len(full.faces)


def test_decimation_that_opens_the_mesh_is_tried_in_steps(monkeypatch):
    """Here a collapse to fewer than a quarter of the triangles opens the mesh."""
    import fast_simplification

    collapse = fast_simplification.simplify

    def fragile(points, faces, target_count, **given):
        found = collapse(points, faces, target_count=target_count, **given)
        return found if 4 * target_count >= len(faces) else (found[0], found[1][1:])

    monkeypatch.setattr(fast_simplification, "simplify", fragile)
    small = export.mesh(ball(32), faces=100)
    assert 4 <= len(small.faces) <= 100 and small.is_watertight


def test_the_largest_part_is_one_surface():
    """Voxels that share a corner are one part of a volume, and two surfaces; what encloses next to nothing is none."""
    v = block((2, 2, 2), (12, 12, 12)) + block((12, 12, 12), (18, 18, 18))
    assert export.mesh(v, smooth=0).body_count == 2
    one = export.mesh(v, smooth=0, largest=True)
    assert one.body_count == 1 and one.is_watertight
    assert one.volume == pytest.approx(export.mesh(block((2, 2, 2), (12, 12, 12)), smooth=0).volume)
    equal = block((2, 2, 2), (8, 8, 8)) + block((8, 8, 8), (14, 14, 14))
    assert export.mesh(equal, smooth=0, largest=True).body_count == 1
    crumb = block((2, 2, 2), (12, 12, 12)) + block((12, 12, 12), (14, 14, 14))
    assert export.mesh(crumb, smooth=0).body_count == 1


def test_floaters_and_hidden_hollows_are_left_out():
    v = block((4, 4, 4), (20, 20, 20)) - block((8, 8, 8), (12, 12, 12))
    v[22, 22, 22] = 1
    assert export.mesh(v).body_count == 1


@pytest.mark.parametrize(
    ("volumes", "says"),
    [
        (np.zeros((0, 8, 8, 8)), "at least 1"),
        (np.zeros((8, 8)), "volumes are"),
        (np.zeros((2, 3, 8, 8)), "images"),
        (np.stack([np.ones((8, 8, 8)), np.full((8, 8, 8), np.nan)]), "shape 1 holds NaN"),
    ],
)
@pytest.mark.parametrize("to", export.FORMATS)
def test_bad_volumes_are_named_by_every_format(tmp_path, volumes, says, to):
    with pytest.raises(UserError, match=says):
        export.write(volumes, to, tmp_path / "out")
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("to", export.FORMATS)
def test_images_are_for_sheets_alone(tmp_path, to):
    images = np.zeros((2, 1, 8, 8))
    if to == "png":
        assert [path.name for path in export.write(images, to, tmp_path).paths] == ["contact_sheet.png"]
        return
    with pytest.raises(UserError, match="images"):
        export.write(images, to, tmp_path)


def test_an_unknown_format_names_the_known_ones(tmp_path):
    with pytest.raises(UserError, match="'stl'.*glb, obj, ply, vox, npz, png, gif"):
        export.write(ball(), "stl", tmp_path)


def test_names_must_be_different_and_as_many(tmp_path):
    with pytest.raises(UserError, match="2 different names"):
        export.glb(np.stack([ball(), ball()]), tmp_path, names=["a", "a"])
    with pytest.raises(UserError, match="2 different names, 3 were given, 2 of them different"):
        export.glb(np.stack([ball(), ball()]), tmp_path, names=["a", "a", "b"])


@pytest.mark.parametrize("to", ["glb", "vox"])
@pytest.mark.parametrize("name", ["../a", "/a", "a/b", "a\\b", "C:a", "..", ".", "", "a\0"])
def test_names_do_not_lead_out_of_the_folder(tmp_path, to, name):
    with pytest.raises(UserError, match="is not that of a file"):
        export.FORMATS[to](ball(), tmp_path / "out", names=[name])
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("to", ["glb", "vox"])
def test_shapes_of_a_larger_batch_are_named(tmp_path, to):
    (tmp_path / f"mine.{to}").write_text("kept")
    export.FORMATS[to](np.stack([ball()] * 4), tmp_path)
    with pytest.warns(UserWarning, match=f"shape_02.{to} and 1 more are of an earlier export"):
        export.FORMATS[to](np.stack([ball()] * 2), tmp_path)
    assert len(os.listdir(tmp_path)) == 5
    export.FORMATS[to](ball(), tmp_path, names=["shape_01"])  # one that is chosen is put beside the others


@pytest.mark.parametrize("to", export.FORMATS)
def test_a_disk_that_fills_up_leaves_what_was_there(tmp_path, monkeypatch, to):
    path = tmp_path / f"x.{to}"
    path.write_bytes(b"old")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="No space"):
        export.write(block((2, 2, 2), (6, 6, 6), 8), to, path, **({"frames": 2, "size": 16} if to == "gif" else {}))
    assert path.read_bytes() == b"old" and os.listdir(tmp_path) == [path.name]
