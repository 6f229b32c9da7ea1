"""Pictures: what stands right appears right, turns as the convention says, and GIFs loop."""

from __future__ import annotations

import io
import math
import os

import numpy as np
import pytest
import torch
from PIL import Image

from unproject import export
from unproject._types import UserError
from unproject.export.rendering import camera_axes, fitted_extent, rasterise


def arrow(n=16):
    """A thin bar through the origin with a head at +x."""
    v = np.zeros((n, n, n), np.float32)
    v[1 : n - 1, 7:9, 7:9] = 1
    v[n - 5 : n - 1, 4:12, 4:12] = 1
    return v


def inked(picture):
    """Columns' share of pixels that show the shape."""
    return (np.asarray(picture).min(-1) < 235).mean(0)


def view(azimuth, elevation=0.0, volume=None):
    return export.render_volume(arrow() if volume is None else volume, azimuth, elevation, 48, extent=1.2)


def test_the_head_is_right_at_0_left_at_180_and_towards_the_viewer_at_90():
    front, back, side = inked(view(0)), inked(view(math.pi)), inked(view(math.pi / 2))
    assert front[24:].sum() > 1.5 * front[:24].sum()
    np.testing.assert_allclose(back, front[::-1], atol=0.05)
    np.testing.assert_allclose(side, side[::-1], atol=0.05)
    assert (side > 0).sum() == pytest.approx((front > 0).sum() * 8 / 14, abs=2)


def test_the_silhouette_of_a_box_has_its_exact_area():
    box = np.zeros((16, 16, 16), np.float32)
    box[4:12, 2:14, 4:12] = 1
    covered = np.asarray(view(0, volume=box)).min(-1) < 235
    assert covered.mean() == pytest.approx(1.0 * 1.5 / 2.4**2, rel=0.06)
    rows = np.flatnonzero(covered.any(1))
    assert abs(rows.min() + rows.max() - 47) <= 1


def test_higher_is_nearer_the_top_and_nearer_hides_farther():
    v = np.zeros((16, 16, 16), np.float32)
    v[4:12, 10:14, 4:12] = 1
    rows = np.flatnonzero((view(0, volume=v).min(-1) < 235).any(1))
    assert rows.max() < 24


def test_seen_from_above_the_far_end_is_higher():
    """The head at azimuth 270° points away from the camera, so at a positive elevation it appears higher."""
    rows = (view(math.radians(270), math.radians(40)).min(-1) < 150).sum(1)
    away = rows[:24].sum()
    rows = (view(math.radians(90), math.radians(40)).min(-1) < 150).sum(1)
    assert away > rows[:24].sum()


@pytest.mark.parametrize("azimuth", [0.0, 0.7, 2.5])
@pytest.mark.parametrize("elevation", [-0.4, 0.0, 0.9])
def test_the_camera_is_orthonormal_right_handed_and_stands_where_the_convention_says(azimuth, elevation):
    camera = camera_axes(azimuth, elevation)
    np.testing.assert_allclose(camera @ camera.T, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(np.cross(camera[0], camera[1]), camera[2], atol=1e-12)
    a, e = azimuth, elevation
    expected = [math.sin(a) * math.cos(e), math.sin(e), math.cos(a) * math.cos(e)]
    np.testing.assert_allclose(camera[2], expected, atol=1e-12)


def test_the_rasteriser_sees_the_nearer_of_two_triangles_and_no_back():
    points = np.array([[-1, -1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 1], [0, -1, 1], [-1, 0, 1]], float)
    seen, face, weights = rasterise(points, np.array([[0, 1, 2], [3, 4, 5], [0, 2, 1]]), 16)
    assert seen.sum() == 16 * 17 / 2 and set(face) == {0, 1}
    assert (face == 1).sum() == 8 * 9 / 2
    np.testing.assert_allclose(weights.sum(1), 1)
    rows, columns = np.nonzero(seen)
    pixels = (weights[..., None] * points[np.array([[0, 1, 2], [3, 4, 5]])[face]]).sum(1)[:, :2]
    np.testing.assert_allclose(pixels, np.stack([(columns + 0.5) / 8 - 1, 1 - (rows + 0.5) / 8], 1), atol=1e-9)


def test_the_fitted_view_shows_the_shape_whole_at_every_azimuth():
    volume = np.ones((8, 8, 8), np.float32)
    for azimuth in (0, math.pi / 4, 1.0):
        picture = export.render_volume(volume, azimuth, math.radians(20), 48)
        border = np.concatenate([picture[0], picture[-1], picture[:, 0], picture[:, -1]])
        assert (border > 140).all()
    assert fitted_extent(volume, 0.0) == pytest.approx(1.06 * math.sqrt(2))


def test_an_empty_volume_is_a_white_picture():
    assert (export.render_volume(np.zeros((8, 8, 8)), 0.3, size=16) == 255).all()


def test_contact_sheet_has_shapes_down_and_views_across(tmp_path):
    volumes = torch.from_numpy(np.stack([arrow(), np.zeros_like(arrow()), arrow()]))
    sheet = export.contact_sheet(volumes, tmp_path / "sheet.png", azimuths=(0, math.pi), elevation=0, size=40)
    label = sheet.height - 3 * 40
    assert sheet.width == 80
    pixels = np.asarray(sheet)[label:]
    front, back = inked(pixels[:40, :40]), inked(pixels[:40, 40:])
    assert front[20:].sum() > front[:20].sum() and back[:20].sum() > back[20:].sum()
    assert (pixels[40 + 16 : 80] == 255).all()
    with Image.open(tmp_path / "sheet.png") as saved:
        assert (np.asarray(saved) == np.asarray(sheet)).all()


def test_gallery_is_a_grid():
    assert export.gallery(np.stack([arrow()] * 5), size=24).size == (72, 48)
    assert export.gallery(np.stack([arrow()] * 5), size=24, columns=5).size == (120, 24)


def test_silhouettes_are_black_on_white(tmp_path):
    masks = torch.zeros(3, 1, 8, 8)
    masks[0, 0, 0] = 1
    sheet = np.asarray(export.silhouette_sheet(masks, tmp_path / "masks.png", scale=2))
    assert sheet.shape == (34, 34, 3) and (sheet[:2, :16] == 0).all() and (sheet[2:16, :16] == 255).all()
    with pytest.raises(UserError, match="silhouettes are"):
        export.silhouette_sheet(torch.zeros(3, 2, 8, 8))


@pytest.mark.parametrize("of", [torch.Tensor.numpy, torch.Tensor.requires_grad_])
def test_images_are_written_as_they_are(tmp_path, of):
    images = torch.zeros(1, 1, 8, 8)
    images[..., 2:6, 2:6] = 1.5  # as of a fit
    (path,) = export.write(of(images), "png", tmp_path / "images.png").paths
    with Image.open(path) as written:
        assert [written.convert("L").getpixel(place) for place in ((0, 0), (16, 16))] == [0, 255]


def test_a_turntable_has_its_frames_and_loops(tmp_path):
    written = export.turntable(np.stack([arrow()] * 2), tmp_path / "turn.gif", frames=7, size=32)
    assert os.listdir(tmp_path) == ["turn.gif"] and written.paths == (tmp_path / "turn.gif",)
    with Image.open(io.BytesIO(written.paths[0].read_bytes())) as gif:
        assert (gif.n_frames, gif.info["loop"], gif.size) == (7, 0, (64, 32))
        assert (np.asarray(gif.convert("RGB"))[0, 0] == 255).all()


def test_a_shape_that_looks_alike_from_everywhere_keeps_its_frames(tmp_path):
    export.turntable(np.zeros((8, 8, 8)), tmp_path / "still.gif", frames=4, size=16)
    with Image.open(io.BytesIO((tmp_path / "still.gif").read_bytes())) as gif:
        assert gif.info["loop"] == 0


def test_a_turntable_too_large_is_shrunk(tmp_path, monkeypatch):
    monkeypatch.setattr("unproject.export.pictures._LARGEST_GIF", 3000)
    export.turntable(arrow(), tmp_path / "small.gif", frames=4, size=64)
    assert (tmp_path / "small.gif").stat().st_size <= 3000


def test_a_turntable_reports_its_progress(tmp_path):
    done = []
    export.turntable(arrow(), tmp_path / "t.gif", frames=3, size=16, track=lambda r: (done.append(i) or i for i in r))
    assert done == [0, 1, 2]


def test_mistakes_are_named(tmp_path):
    with pytest.raises(UserError, match="at least 2"):
        export.turntable(arrow(), tmp_path / "t.gif", frames=1)
    with pytest.raises(UserError, match="use .png"):
        export.contact_sheet(arrow(), tmp_path / "sheet.what", size=16)
    with pytest.raises(UserError, match="at least 8 pixels"):
        export.render_volume(arrow(), 0, size=4)


@pytest.mark.parametrize(
    ("to", "name"), [("png", "contact_sheet.png"), ("gif", "turntable.gif"), ("npz", "volumes.npz")]
)
def test_formats_of_one_file_have_a_name_in_a_folder(tmp_path, to, name):
    options = {} if to == "npz" else {"size": 16}
    (path,) = export.write(arrow(), to, tmp_path / "out", **options).paths
    assert path == tmp_path / "out" / name and os.listdir(path.parent) == [name]


def test_npz_is_what_sample_writes(tmp_path):
    (path,) = export.npz(torch.from_numpy(arrow()), tmp_path / "v.npz").paths
    with np.load(path) as arrays:
        assert arrays.files == ["volume"] and arrays["volume"].dtype == np.float32
        assert (arrays["volume"] == arrow()[None]).all()


def test_silhouettes_lose_nothing_as_webp_and_shaded_pictures_are_small(tmp_path):
    masks = np.random.default_rng(0).random((4, 32, 32))
    sheet = export.silhouette_sheet(masks, tmp_path / "masks.webp")
    with Image.open(tmp_path / "masks.webp") as stored:
        assert np.array_equal(np.asarray(stored.convert("RGB")), np.asarray(sheet))
    for suffix in (".webp", ".png"):
        export.gallery(arrow()[None], tmp_path / f"shape{suffix}")
    assert (tmp_path / "shape.webp").stat().st_size < (tmp_path / "shape.png").stat().st_size
