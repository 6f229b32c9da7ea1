"""3-D collections: voxel files written by hand, meshes of known volume, and projections of volumes."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import trimesh
from scipy.ndimage import label

from unproject._types import UserError
from unproject.data import Collection, observe, read
from unproject.data.readers.shapes import read_binvox, read_mesh
from unproject.data.readers.voxelise import coverage, crossings, normalised, voxelise

MODELNET = Path(__file__).parents[3].parent / "shared/data/shapes3d/modelnet7_vox30_packbits.npz"


def write_binvox(path: Path, grid: np.ndarray) -> None:
    """By the format's page: y runs fastest, then z, then x; runs of at most 255."""
    depth, height, width = grid.shape
    flat = [bool(grid[x, y, z]) for x in range(depth) for z in range(width) for y in range(height)]
    body, run = b"", 1
    for here, following in zip(flat, [*flat[1:], None]):
        if here == following and run < 255:
            run += 1
        else:
            body, run = body + bytes([here, run]), 1
    head = f"#binvox 1\ndim {depth} {height} {width}\ntranslate 0 0 0\nscale 1\ndata\n"
    path.write_bytes(head.encode() + body)


def test_binvox_round_trip_keeps_the_axes(tmp_path):
    grid = np.random.default_rng(0).random((9, 9, 9)) > 0.7
    grid[:, 2] = True
    write_binvox(tmp_path / "a.binvox", grid)
    assert np.array_equal(read_binvox(tmp_path / "a.binvox"), grid)
    assert np.array_equal(read(tmp_path / "a.binvox").items[0], grid)


def test_a_shape_of_nothing_is_skipped(tmp_path):
    write_binvox(tmp_path / "a.binvox", np.ones((4, 4, 4), bool))
    write_binvox(tmp_path / "b.binvox", np.zeros((4, 4, 4), bool))
    found = read(tmp_path)
    assert found.names == ("a.binvox",) and dict(found.skipped) == {"b.binvox": "empty: no voxel is occupied"}
    with pytest.raises(UserError, match="no voxel is occupied"):
        read(tmp_path / "b.binvox")


def test_a_binvox_that_is_no_cube_is_padded(tmp_path):
    write_binvox(tmp_path / "a.binvox", np.ones((4, 8, 6), bool))
    padded = read_binvox(tmp_path / "a.binvox")
    assert padded.shape == (8, 8, 8) and padded[2:6, :, 1:7].min() == 1 and padded.sum() == 4 * 8 * 6


def test_damaged_binvox_files_are_skipped_or_refused(tmp_path):
    write_binvox(tmp_path / "a.binvox", np.ones((8, 8, 8), bool))
    whole = (tmp_path / "a.binvox").read_bytes()
    (tmp_path / "cut.binvox").write_bytes(whole[:-2])
    (tmp_path / "foreign.binvox").write_bytes(b"hello")
    found = read(tmp_path)
    assert found.names == ("a.binvox",)
    assert "voxels where 512 are announced" in dict(found.skipped)["cut.binvox"]
    with pytest.raises(UserError, match="no binvox header"):
        read(tmp_path / "foreign.binvox")
    with pytest.raises(UserError, match="--strict"):
        read(tmp_path, strict=True)


def test_grids_of_different_sizes_need_a_size(tmp_path):
    write_binvox(tmp_path / "a.binvox", np.ones((8, 8, 8), bool))
    write_binvox(tmp_path / "b.binvox", np.ones((16, 16, 16), bool))
    with pytest.raises(UserError, match=r"different sizes \(a.binvox 8, b.binvox 16\); give a size"):
        read(tmp_path)
    assert read(tmp_path, size=8).items.shape == (2, 8, 8, 8)


def test_a_solid_box_has_its_volume_and_place():
    mesh = trimesh.creation.box(extents=(1.0, 0.5, 0.7))
    mesh.apply_translation((0.2, -0.3, 0.1))
    share = coverage(mesh.vertices, mesh.faces, 32)
    assert share.mean() * 8 == pytest.approx(0.35, rel=0.03)
    centres = (np.arange(32) + 0.5) / 16 - 1
    for axis, centre in enumerate((0.2, -0.3, 0.1)):
        mass = share.sum(tuple(a for a in range(3) if a != axis))
        assert (mass * centres).sum() / mass.sum() == pytest.approx(centre, abs=0.01)


@pytest.mark.parametrize("fill", [voxelise, coverage])
def test_a_solid_sphere_has_its_volume(fill):
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.8)
    assert fill(mesh.vertices, mesh.faces, 32).mean() * 8 == pytest.approx(mesh.volume, rel=0.03)


def test_overlapping_and_inside_out_parts_stay_solid():
    a, b = trimesh.creation.icosphere(4, 0.5), trimesh.creation.icosphere(4, 0.5)
    b.apply_translation((0.3, 0, 0))
    both = trimesh.util.concatenate([a, b])
    volume = 2 * a.volume - math.pi * (4 * 0.5 + 0.3) * (2 * 0.5 - 0.3) ** 2 / 12
    assert coverage(both.vertices, both.faces, 32).mean() * 8 == pytest.approx(volume, rel=0.03)
    assert np.allclose(voxelise(a.vertices, a.faces[:, ::-1], 32), voxelise(a.vertices, a.faces, 32))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_winding_number_of_a_closed_mesh_is_one_inside_from_every_side(axis):
    mesh = trimesh.creation.icosphere(3, 0.7)
    triangles = (mesh.triangles + 1) * 12 - 0.5
    windings = np.cumsum(crossings(triangles, axis, 24)[0], -1)
    assert set(np.unique(windings)) == {0, 1} and windings[12, 12, 12] == 1 and (windings[..., -1] == 0).all()


def test_a_mesh_with_a_hole_is_still_solid():
    mesh = trimesh.creation.icosphere(4, 0.8)
    open_faces = mesh.faces[mesh.triangles_center[:, 1] < 0.6]
    holed = coverage(mesh.vertices, open_faces, 32).mean() * 8
    assert holed == pytest.approx(mesh.volume, rel=0.1)
    below = mesh.volume - math.pi * 0.2**2 * (3 * 0.8 - 0.2) / 3
    assert holed > 0.97 * below


def test_a_sheet_without_thickness_is_kept():
    corners = np.array([[-0.5, 0.01, -0.5], [0.5, 0.01, -0.5], [0.5, 0.01, 0.5], [-0.5, 0.01, 0.5]])
    volume = voxelise(corners, np.array([[0, 1, 2], [0, 2, 3]]), 32)
    assert volume.sum(1).max() == 1 and int(volume.sum()) == pytest.approx(256, rel=0.15)


def table(top: float, leg: float) -> trimesh.Trimesh:
    """A plate on four legs, all of them closed, 1 wide and high."""
    plate = trimesh.creation.box((1, top, 1))
    plate.apply_translation((0, 1 - top / 2, 0))
    legs = [trimesh.creation.box((leg, 1, leg)) for _ in range(4)]
    for one, (x, z) in zip(legs, ((-0.45, -0.45), (-0.45, 0.45), (0.45, -0.45), (0.45, 0.45)), strict=True):
        one.apply_translation((x, 0.5, z))
    return trimesh.util.concatenate([plate, *legs])


@pytest.mark.parametrize("size", [32, 64])
@pytest.mark.parametrize(
    "top, leg", [(0.005, 0.005), (0.1, 0.03), (0.04, 0.04), (0.03, 0.03), (0.02, 0.06), (0.02, 0.02), (0.06, 0.02)]
)
def test_thin_tops_and_legs_are_kept(top, leg, size):
    mesh = table(top, leg)
    volume = voxelise(normalised(mesh.vertices), mesh.faces, size)
    rows = volume.sum((0, 2)).nonzero()[0]
    assert label(volume)[1] == 1  # by faces
    assert rows[-1] - rows[0] + 1 == pytest.approx(volume.sum((1, 2)).nonzero()[0].size, abs=2)  # as high as wide
    side = volume.sum((1, 2)).nonzero()[0].size
    assert volume.sum((0, 2)).max() == pytest.approx(side**2, rel=0.2)  # the top
    middle = volume[:, rows[len(rows) // 2]]
    assert label(middle)[1] == 4 and middle.sum() <= 4 * max(4, (leg * side + 1) ** 2)


@pytest.mark.parametrize("radius, tilt", [(0.015, 0.3), (0.026, 0.3), (0.026, 0.8), (0.03, 0.2)])
def test_slanting_legs_are_whole(radius, tilt):
    """Where they are about as thick as a voxel, some voxels are more than half covered, and some between are less."""
    rod, ball = trimesh.creation.cylinder(radius, 1.2, sections=12), trimesh.creation.icosphere(3, 0.25)
    rod.apply_transform(trimesh.transformations.rotation_matrix(tilt, (1, 0.3, 0)))
    both = trimesh.util.concatenate([rod, ball])
    volume = voxelise(both.vertices, both.faces, 32)
    assert label(volume, np.ones((3, 3, 3)))[1] == 1
    length = np.linalg.norm(np.ptp(np.argwhere(volume), axis=0)) / 16
    assert length == pytest.approx(1.2, abs=0.2)


def test_thick_parts_stay_as_they_are():
    turned = trimesh.creation.box((0.9, 0.5, 0.7))
    turned.apply_transform(trimesh.transformations.rotation_matrix(0.5, (1, 2, 3)))
    share = coverage(turned.vertices, turned.faces, 32)
    assert share.sum() == pytest.approx(turned.volume * 16**3, rel=0.01)


def test_normalising_fits_the_box_and_the_cylinder():
    tall = normalised(trimesh.creation.box(extents=(1, 10, 2)).vertices + 5)
    assert np.abs(tall).max() == pytest.approx(0.9) and np.abs(tall.sum(0)).max() < 1e-9
    flat = normalised(trimesh.creation.box(extents=(3, 1, 3)).vertices)
    assert np.hypot(flat[:, 0], flat[:, 2]).max() == pytest.approx(0.95)


@pytest.mark.parametrize("suffix", ["obj", "stl", "ply", "glb", "off"])
def test_meshes_of_every_format_are_read_upright(tmp_path, suffix):
    parts = trimesh.creation.box(extents=(1, 0.2, 0.6)), trimesh.creation.box(extents=(0.2, 1, 0.2))
    parts[1].apply_translation((0, 0.5, 0.2))
    path = tmp_path / f"a.{suffix}"
    trimesh.util.concatenate(parts).export(path)
    volume = read(path).items[0]
    assert volume.shape == (32, 32, 32)
    assert volume[:, :16].sum() > volume[:, 16:].sum() > 0 and volume[:, 20:, 16:].sum() > volume[:, 20:, :16].sum()
    turned = Collection.volumes(path, 16, up_axis="z").items[0]
    assert turned.shape == (16, 16, 16) and turned[:, :, :8].sum() != turned[:, :, 8:].sum()


def test_unreadable_meshes_are_named_and_skipped(tmp_path):
    trimesh.creation.icosphere(2).export(tmp_path / "a.ply")
    (tmp_path / "b.ply").write_bytes(b"ply\nnonsense")
    (tmp_path / "c.obj").write_text("v 0 0 0\n")
    found = read(tmp_path, size=16)
    assert found.names == ("a.ply",) and {name for name, _ in found.skipped} == {"b.ply", "c.obj"}
    with pytest.raises(ValueError, match="unreadable mesh"):
        read_mesh(tmp_path / "b.ply")


def packed(path: Path) -> np.ndarray:
    grids = np.zeros((4, 30, 30, 30), np.uint8)
    grids[:, 10:20, 5, 3:9] = 1
    bits = np.packbits(grids.reshape(4, -1), axis=1)
    labels, names = np.array([0, 2, 2, 0], np.uint8), np.array(["bed", "bath", "chair"])
    np.savez(path, X_train=bits, y_train=labels, X_test=bits[:1], y_test=labels[1:2], class_names=names, shape=[30] * 3)
    return grids


def test_packed_archives_are_selected_turned_up_and_padded(tmp_path):
    grids = packed(tmp_path / "a.npz")
    chairs = read(f"{tmp_path}/a.npz:chair")
    assert chairs.names == ("chair_00001", "chair_00002") and chairs.items.shape == (2, 32, 32, 32)
    occupied = chairs.items[0].nonzero()
    assert occupied.amin(0).tolist() == [11, 4, 32 - 1 - 6] and occupied.amax(0).tolist() == [20, 9, 25]
    assert chairs.items[0].sum() == grids[0].sum()
    assert len(read(tmp_path / "a.npz")) == 4 and len(read(f"{tmp_path}/a.npz:chair/test")) == 1
    assert len(Collection.volumes(tmp_path / "a.npz", classes=("bed", "chair"), split="train")) == 4
    with pytest.raises(UserError, match="no class 'sofa'; it has bed, chair"):
        read(f"{tmp_path}/a.npz:sofa")
    with pytest.raises(UserError, match="no split 'dev'; it has train, test"):
        Collection.volumes(tmp_path / "a.npz", split="dev")  # type: ignore[arg-type]


def test_selecting_from_what_has_no_classes(tmp_path):
    chair = np.zeros((1, 8, 8, 8), bool)
    chair[:, 2:6] = True
    np.savez(tmp_path / "a.npz", volume=chair)
    with pytest.raises(UserError, match="holds no classes to choose from"):
        read(f"{tmp_path}/a.npz:chair")
    assert Collection.volumes(tmp_path / "a.npz", 8).items.shape == (1, 8, 8, 8)
    np.savez(tmp_path / "bits.npz", volume=np.packbits(chair.reshape(1, 512), axis=1), shape=[8, 8, 8])
    for path in (tmp_path / "a.npz", tmp_path / "bits.npz", tmp_path):
        with pytest.raises(UserError, match="holds no classes to choose from, nor training and test parts"):
            Collection.volumes(path, 8, classes=("chair",))
        with pytest.raises(UserError, match="holds no classes to choose from, nor training and test parts"):
            Collection.volumes(path, 8, split="test")
    with pytest.raises(UserError, match="holds no classes to choose from"):
        read(f"{tmp_path}/bits.npz:chair")


def test_packed_volume_with_its_shape(tmp_path):
    grid = np.random.default_rng(0).random((2, 10, 10, 10)) > 0.5
    np.savez(tmp_path / "a.npz", volume=np.packbits(grid.reshape(2, -1), axis=1), shape=[10, 10, 10])
    assert np.array_equal(read(tmp_path / "a.npz").items, grid)
    np.savez(tmp_path / "a.npz", volume=np.zeros((2, 7), np.uint8), shape=[10, 10, 10])
    with pytest.raises(UserError, match="pack with np.packbits"):
        read(tmp_path / "a.npz")


@pytest.mark.skipif(not MODELNET.exists(), reason="shared data is not here")
def test_real_chairs_stand_upright():
    chairs = read(f"{MODELNET}:chair/test").floats()
    assert chairs.shape == (100, 32, 32, 32)
    legs, seats = chairs[:, :, 6:10].mean(), chairs[:, :, 13:17].mean()
    assert float(seats) > 1.5 * float(legs)


def observations(*offsets: float):
    """Projections along z whose latent scales the picture, as duck-typed Observations."""

    def prior(offset):
        return SimpleNamespace(sample=lambda n, rng: {"azimuth": offset + 0.1 * torch.rand(n, generator=rng)})

    def project(x, azimuth):
        return x.amax(3)[:, None] * azimuth[:, None, None, None]

    return [SimpleNamespace(prior=prior(offset), projection=project) for offset in offsets]


def test_rendered_images_carry_their_own_latents():
    shapes = Collection(torch.eye(8).expand(5, 8, 8, 8), names=list("abcde"))
    seen = observe(shapes, observations(0.2, 0.6), each=7, seed=3, chunk=4)
    assert len(seen) == 35 and seen.names[:2] == ("a#0", "a#1") and seen.latents is not None
    azimuth, view = seen.latents["azimuth"], seen.latents["view"]
    assert torch.allclose(seen.items.amax((1, 2, 3)), azimuth) and torch.equal(view, (azimuth > 0.4).float())
    assert 0 < view.mean() < 1
    again = observe(shapes, observations(0.2, 0.6), each=7, seed=3, chunk=4)
    other = observe(shapes, observations(0.2, 0.6), each=7, seed=4, chunk=4, binary=True)
    assert torch.equal(again.items, seen.items) and set(other.items.unique().tolist()) == {0.0, 1.0}


def test_observations_that_share_a_projection_are_projected_at_once():
    shapes = torch.rand(6, 8, 8, 8, generator=torch.Generator().manual_seed(0))
    together, apart = observations(0.2, 0.6, 0.9), [observations(offset)[0] for offset in (0.2, 0.6, 0.9)]
    calls, project = [], together[0].projection

    def counted(x, azimuth):
        calls.append(len(x))
        return project(x, azimuth)

    for one in together:
        one.projection = counted
    seen, other = (observe(shapes, some, each=4, seed=3) for some in (together, apart))
    assert calls == [24]
    assert torch.equal(seen.items, other.items) and seen.latents is not None and other.latents is not None
    assert all(torch.equal(seen.latents[name], other.latents[name]) for name in ("azimuth", "view"))


def test_observations_that_draw_different_latents_are_refused():
    strange = SimpleNamespace(prior=SimpleNamespace(sample=lambda n, rng: {}), projection=lambda x: x.amax(3)[:, None])
    with pytest.raises(UserError, match="different latents"):
        observe(torch.ones(20, 8, 8, 8), [*observations(0.5), strange])
    with pytest.raises(UserError, match="at least one observation"):
        observe(torch.ones(2, 8, 8, 8), [])


def test_hidden_folders_are_left_out(tmp_path):
    for name in ("a.binvox", ".trash/b.binvox", "__MACOSX/c.binvox", "__private.binvox", ".d.binvox"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        write_binvox(tmp_path / name, np.ones((4, 4, 4), bool))
    assert Collection.volumes(tmp_path, 4).names == ("__private.binvox", "a.binvox")
