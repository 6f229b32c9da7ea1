"""MagicaVoxel files, read back by a reader of our own."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from unproject import export
from unproject._types import UserError


def read_vox(path):
    """(size in MagicaVoxel's axes, {(x, y, z): colour}, palette) of a .vox file."""
    data = path.read_bytes()
    assert data[:4] == b"VOX " and struct.unpack_from("<i", data, 4) == (150,)
    name, own, children = struct.unpack_from("<4s2i", data, 8)
    assert (name, own, children) == (b"MAIN", 0, len(data) - 20)
    chunks, at = {}, 20
    while at < len(data):
        name, own, children = struct.unpack_from("<4s2i", data, at)
        chunks[name] = data[at + 12 : at + 12 + own]
        at += 12 + own + children
    (count,) = struct.unpack_from("<i", chunks[b"XYZI"])
    voxels = np.frombuffer(chunks[b"XYZI"], np.uint8, offset=4).reshape(count, 4)
    assert len(chunks[b"RGBA"]) == 1024
    return struct.unpack("<3i", chunks[b"SIZE"]), voxels.astype(int), chunks[b"RGBA"]


def test_read_back_equals_the_volume(tmp_path):
    v = np.random.default_rng(0).random((5, 7, 9)) > 0.6
    (path,) = export.vox(v, tmp_path / "noise.vox").paths
    size, voxels, palette = read_vox(path)
    assert size == (5, 9, 7)
    back = np.zeros_like(v)
    # theirs: x right, y away from the viewer, z up; ours: x right, y up, z towards the viewer
    back[voxels[:, 0], voxels[:, 2], 9 - 1 - voxels[:, 1]] = True
    assert (back == v).all() and (voxels[:, 3] == 1).all() and palette[3] == 255


def test_up_is_z_and_the_viewer_is_at_minus_y(tmp_path):
    v = np.zeros((8, 8, 8))
    v[0, 7, 0] = 1
    (path,) = export.vox(v, tmp_path / "one.vox").paths
    assert read_vox(path)[1][:, :3].tolist() == [[0, 7, 7]]


def test_a_folder_and_its_empty_shapes(tmp_path):
    written = export.vox(np.stack([np.ones((8, 4, 4)), np.zeros((8, 4, 4)), np.ones((8, 4, 4))]), tmp_path)
    assert [p.name for p in written.paths] == ["shape_00.vox", "shape_02.vox"] and len(written.skipped) == 1


def test_256_is_the_longest_axis(tmp_path):
    assert export.vox(np.ones((256, 5, 1)), tmp_path / "x.vox").paths
    with pytest.raises(UserError, match="257 voxels"):
        export.vox(np.ones((257, 5, 1)), tmp_path / "x.vox")


def test_one_file_takes_one_shape(tmp_path):
    with pytest.raises(UserError, match="one shape, not 2"):
        export.vox(np.ones((2, 8, 8, 8)), tmp_path / "x.vox")
