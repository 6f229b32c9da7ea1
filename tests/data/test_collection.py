"""Collections: from memory and from paths, kept as they came, converted by the batch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image
from torch import Tensor

from unproject._types import UserError
from unproject.data import Collection, Framing, read
from unproject.data.readers import found as found_module

masks = np.zeros((3, 20, 20), bool)
masks[:, 4:16, 6:10] = True


def test_a_collection_of_items_in_memory() -> None:
    found = Collection(masks)
    assert found.names[0] == "00000" and len(found) == 3 and found.shape == (20, 20)
    again = Collection(masks, latents={"azimuth": [0.0, 1.0, 2.0]}, names=["a", "b", "c"])
    some = again.subset([2, 0])
    assert some.names == ("c", "a") and some.latents is not None
    assert some.latents["azimuth"].tolist() == [2, 0] and torch.equal(some.items, again.items[[2, 0]])
    assert "3 items of 20 x 20" in repr(again) and "known azimuth" in repr(again)
    with pytest.raises(UserError, match="3 items but 2 values of names"):
        Collection(masks, names=["a", "b"])
    with pytest.raises(UserError, match="NaN"):
        Collection(np.array([[np.nan]]))
    with pytest.raises(UserError, match="azimuth has values that are NaN"):
        Collection(masks, latents={"azimuth": [0.0, np.nan, 2.0]})
    with pytest.raises(UserError, match="holds no items"):
        Collection(np.zeros((0, 4)))
    with pytest.raises(UserError, match="masks/: a Collection is made of items; read a path with"):
        Collection("masks/")
    with pytest.raises(AttributeError):
        found.items = torch.zeros(1)  # type: ignore[misc]


@pytest.mark.parametrize(
    ("items", "stored", "white"),
    [
        (masks, torch.uint8, 1),
        (masks.astype(np.uint8), torch.uint8, 1),
        (masks * np.uint8(255), torch.uint8, 255),
        (masks.astype(np.float64), torch.float32, 1),
        (masks.astype(np.float32), torch.float32, 1),
    ],
)
def test_items_stay_as_they_came_and_a_batch_is_floats(items: np.ndarray, stored: torch.dtype, white: int) -> None:
    found = Collection(items)
    assert found.items.dtype == stored and found.white == white
    for batch in (found.batch([1, 2]), found.batch(torch.tensor([1, 2])), found.batch(slice(1, 3)), found.floats()[1:]):
        assert batch.dtype == torch.float32 and torch.equal(batch, torch.from_numpy(masks[1:]).float())


@pytest.mark.parametrize("dtype", [">f4", ">f8", "f4", bool])
def test_arrays_of_other_programs_are_taken_as_they_come(tmp_path: Path, dtype: Any) -> None:
    """FITS stores the most significant byte first; pictures are flipped by a stride below 0."""
    tilt = np.arange(3, dtype=">f4")
    found = Collection(masks[:, ::-1].astype(dtype)[:, :, ::-1], latents={"tilt": tilt[::-1]})
    assert torch.equal(found.floats(), torch.from_numpy(masks[:, ::-1, ::-1].copy()).float())
    assert found.latents is not None and found.latents["tilt"].tolist() == [2, 1, 0]
    np.savez(tmp_path / "x.npz", images=masks.astype(dtype), tilt=tilt)
    of_file = Collection.images(tmp_path / "x.npz", latents=["tilt"]).latents
    assert of_file is not None and of_file["tilt"].tolist() == [0, 1, 2]


def test_a_part_of_a_collection_keeps_its_scale() -> None:
    pictures = torch.tensor([[[[0, 1]]], [[[128, 255]]]], dtype=torch.uint8)
    dark = Collection(pictures).subset([0])
    assert dark.items.max() == 1 and dark.batch([0]).max() == torch.tensor(1) / 255


def test_floats_are_not_copied() -> None:
    items = torch.rand(3, 1, 4, 4)
    assert Collection(items).floats().data_ptr() == items.data_ptr()


@pytest.mark.parametrize("kind", [np.uint8, bool, np.float32])
def test_a_npy_file_is_mapped_and_not_read(tmp_path: Path, kind: type) -> None:
    np.save(tmp_path / "a.npy", (masks * 1).astype(kind))
    found = Collection.silhouettes(tmp_path / "a.npy")
    assert torch.equal(found.floats()[:, 0], torch.from_numpy(masks).float())
    mapped = np.load(tmp_path / "a.npy", mmap_mode="r+")
    mapped[0] = 0
    mapped.flush()
    assert found.items[0].sum() == 0, "the items are the file"
    found.items[1] = 0
    assert np.load(tmp_path / "a.npy")[1].any(), "and the file is never written to"


def test_checks_go_through_all_chunks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(found_module, "CHUNK", 400)
    values = np.zeros((5, 20, 20), np.float32)
    values[4, 3, 2] = np.nan
    np.save(tmp_path / "a.npy", values)
    with pytest.raises(UserError, match="has 1 values that are NaN"):
        Collection.images(tmp_path / "a.npy")
    with pytest.raises(UserError, match="NaN"):
        Collection(values)
    late = np.zeros((5, 20, 20), np.uint8)
    late[4, 0, 0] = 200
    assert Collection(late).white == 255


# ------------------------------------------------------------------------------------------------ pictures as they are


@pytest.fixture
def depths(tmp_path: Path) -> Path:
    """Depth maps: smooth, without an outline, brighter at one side."""
    for k in range(3):
        picture = np.tile(np.linspace(40 + k, 200, 48).astype(np.uint8), (32, 1))
        Image.fromarray(picture).save(tmp_path / f"{k}.png")
    return tmp_path


def test_a_folder_of_depth_maps_stays_depth_maps(depths: Path) -> None:
    found = Collection.images(depths)
    assert found.items.dtype == torch.uint8 and found.shape == (1, 32, 48) and found.white == 255
    stored = np.stack([np.asarray(Image.open(depths / f"{k}.png")) for k in range(3)])
    assert np.array_equal(found.items[:, 0], stored)
    assert torch.equal(read(depths, pictures="images").items, found.items)
    rule = Framing(min_pixels=1, mode="keep", polarity="light", photo_threshold=0.5)
    framed = Collection.silhouettes(depths, 48, framing=rule)
    assert set(framed.items.unique().tolist()) <= {0, 255}, "which silhouettes are not"


def test_larger_images_are_averaged_and_smaller_ones_get_a_margin(depths: Path) -> None:
    small = Collection.images(depths, 24)
    assert small.shape == (1, 24, 24) and small.items[:, :, :4].max() == 0 and small.items[:, :, 20:].max() == 0
    whole = Collection.images(depths).floats()
    expected = whole.unflatten(2, (16, 2)).unflatten(4, (24, 2)).mean((3, 5))
    assert (small.floats()[:, :, 4:20] - expected).abs().max() <= 0.51 / 255
    large = Collection.images(depths, 64)
    assert torch.equal(large.items[:, :, 16:48, 8:56], Collection.images(depths).items)
    assert large.floats().sum() == pytest.approx(float(whole.sum()))


def test_images_are_grey_unless_colour_is_asked_for(tmp_path: Path) -> None:
    picture = np.zeros((8, 8, 4), np.uint8)
    picture[..., 0], picture[..., 3] = 255, 255
    picture[:4, :, 3] = 0
    Image.fromarray(picture).save(tmp_path / "a.png")
    grey, colour = Collection.images(tmp_path), Collection.images(tmp_path, colour=True)
    assert grey.shape == (1, 8, 8) and colour.shape == (3, 8, 8)
    assert grey.items[0, 0, 4:].unique().tolist() == [76] and grey.items[0, 0, :4].max() == 0
    assert colour.items[0, :, 6, 6].tolist() == [255, 0, 0]
    np.save(tmp_path / "b.npy", picture[None, ..., :3])
    assert Collection.images(tmp_path / "b.npy").items.unique().tolist() == [76]


def test_deep_images_are_floats(tmp_path: Path) -> None:
    Image.fromarray(np.full((8, 8), 1, np.uint16)).save(tmp_path / "a.png")
    Image.fromarray(np.full((8, 8), 51, np.uint8)).save(tmp_path / "b.png")
    found = Collection.images(tmp_path)
    assert found.items.dtype == torch.float32
    assert found.floats()[:, 0, 0, 0].tolist() == pytest.approx([1 / 65535, 0.2])


def test_images_of_different_sizes_need_a_size(depths: Path) -> None:
    Image.new("L", (10, 8)).save(depths / "small.png")
    with pytest.raises(UserError, match=r"different sizes \(.*small.png 10 x 8.*give a size"):
        Collection.images(depths)
    assert Collection.images(depths, 48).shape == (1, 48, 48)


def test_images_that_cannot_be_read_are_skipped(depths: Path) -> None:
    (depths / "broken.png").write_bytes(b"no picture")
    found = Collection.images(depths)
    assert len(found) == 3 and found.skipped[0][0] == "broken.png"
    with pytest.raises(UserError, match="broken.png: unreadable"):
        Collection.images(depths, strict=True)
    with pytest.warns(UserWarning, match="1 of 4 skipped, the first: broken.png: unreadable"):
        assert found.warn_skipped() is found


# --------------------------------------------------------------------------------------------------------------- kinds


def saved(tmp_path: Path) -> dict[str, Path]:
    np.savez(tmp_path / "pictures.npz", images=masks)
    np.savez(tmp_path / "lines.npz", lines=np.ones((3, 16), np.float32))
    np.savez(tmp_path / "volumes.npz", volume=np.triu(np.ones((2, 8, 8, 8), bool)))
    return {name: tmp_path / f"{name}.npz" for name in ("pictures", "lines", "volumes")}


@pytest.mark.parametrize(
    ("method", "right", "wrong"),
    [
        (Collection.silhouettes, "pictures", "line integrals"),
        (Collection.images, "pictures", "volumes"),
        (Collection.lines, "lines", "pictures"),
        (Collection.volumes, "volumes", "line integrals"),
    ],
)
def test_each_kind_is_read_by_its_method_and_by_no_other(tmp_path: Path, method, right: str, wrong: str) -> None:
    paths = saved(tmp_path)
    assert len(method(paths[right])) >= 2
    with pytest.raises(UserError, match=f"holds {wrong}, not|holds no volumes"):
        method(paths[wrong.split()[0].rstrip("s") + "s"])


def test_volumes_keep_their_bits(tmp_path: Path) -> None:
    path = saved(tmp_path)["volumes"]
    as_stored = Collection.volumes(path, None)
    assert as_stored.items.dtype == torch.uint8 and as_stored.shape == (8, 8, 8)
    assert Collection.volumes(path, 9).items.dtype == torch.uint8, "padded"
    assert Collection.volumes(path).items.dtype == torch.float32, "resampled"
    assert float(Collection.volumes(path, 4).floats().max()) == 1


def test_framed_pictures_keep_8_bits_of_coverage(tmp_path: Path) -> None:
    picture = np.zeros((60, 60), np.uint8)
    picture[10:47, 13:44] = 255
    Image.fromarray(picture).save(tmp_path / "a.png")
    found = Collection.silhouettes(tmp_path, 16)
    coverage: Tensor = found.floats()
    assert found.items.dtype == torch.uint8 and found.white == 255
    assert float(coverage.mean()) == pytest.approx(0.85**2 * 31 / 37, abs=1 / 255)


@pytest.mark.parametrize("kind", [np.int32, np.int64, np.uint16])
def test_integers_of_which_nothing_says_what_is_white_are_refused(kind: type) -> None:
    with pytest.raises(UserError, match="memory: is of type u?int.*; give bool, uint8 or floats"):
        Collection(np.full((2, 1, 8, 8), 255, kind))
