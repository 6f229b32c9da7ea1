"""Arrays: what is accepted, how it is read, and one message for everything else."""

from __future__ import annotations

import gzip
import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from unproject._types import UserError
from unproject.data import Collection, Framing, read

masks = np.zeros((3, 20, 20), bool)
masks[:, 4:16, 6:10] = True


def saved(folder, **arrays):
    np.savez(folder / "x.npz", **arrays)
    return folder / "x.npz"


@pytest.mark.parametrize("key", ["image", "images", "sil", "silhouette", "masks"])
@pytest.mark.parametrize("form", [masks, masks * np.uint8(255), masks * np.float64(1), masks * np.uint8(1)])
def test_pictures_of_every_type_are_the_same(tmp_path, key, form):
    found = read(saved(tmp_path, **{key: form}))
    assert np.array_equal(found.floats()[:, 0], masks)
    assert found.items.dtype == (torch.float32 if form.dtype == np.float64 else torch.uint8)


def test_a_lone_array_needs_no_name_and_labels_are_left_alone(tmp_path):
    found = read(saved(tmp_path, anything=masks, label=np.arange(3)))
    assert found.items.shape == (3, 1, 20, 20) and found.latents is None
    np.save(tmp_path / "y.npy", masks)
    assert torch.equal(read(tmp_path / "y.npy").items, found.items)


def test_volumes_are_kept_as_they_are_and_resized_on_demand(tmp_path):
    x = np.random.default_rng(0).random((2, 30, 30, 30), dtype=np.float32)
    path = saved(tmp_path, volume=x)
    assert np.array_equal(read(path).items, x)
    padded = read(path, size=32).items
    assert np.array_equal(padded[:, 1:31, 1:31, 1:31], x) and padded.sum() == pytest.approx(float(x.sum()), rel=1e-5)
    halved = read(path, size=15).items
    assert float(halved[0, 0, 0, 0]) == pytest.approx(float(x[0, :2, :2, :2].mean()), rel=1e-5)


def test_channels_first_and_last(tmp_path):
    rgba = np.zeros((2, 20, 20, 4), np.float32)
    rgba[:, 5:15, 5:15, 3] = 1
    last = read(saved(tmp_path, images=rgba), framing=Framing()).floats()
    first = read(saved(tmp_path, images=np.moveaxis(rgba, 3, 1)), framing=Framing()).floats()
    assert torch.equal(first, last) and float(last.mean()) == pytest.approx(0.85**2, rel=2e-3)


def test_framing_applies_when_given_and_skips_what_is_empty(tmp_path):
    some = masks.copy()
    some[1] = False
    path = saved(tmp_path, sil=some, azimuth=np.array([0.1, 0.2, 0.3]))
    found = read(path, size=40, framing=Framing())
    assert found.names == ("00000", "00002") and found.skipped[0][0] == "00001" and found.items.shape[2:] == (40, 40)
    assert found.latents is not None and found.latents["azimuth"].tolist() == pytest.approx([0.1, 0.3])
    with pytest.raises(UserError, match="item 1: empty"):
        read(path, framing=Framing(), strict=True)


def test_latents_stand_beside_the_pictures(tmp_path):
    found = read(saved(tmp_path, sil=masks, azimuth=np.arange(3.0), elevation=np.zeros(3, np.float32)))
    assert found.latents is not None and found.latents["azimuth"].tolist() == [0, 1, 2]
    for wrong in (np.arange(2.0), np.array([0, 1, np.nan]), np.array(["a", "b", "c"])):
        with pytest.raises(UserError, match="azimuth: is .*radians .or degrees. for each of 3"):
            read(saved(tmp_path, sil=masks, azimuth=wrong))


def test_axes_in_another_order_and_bad_rows_are_said(tmp_path):
    with pytest.raises(UserError, match=r"for each of 16; \(16, 5\) may have its axes in another order"):
        read(saved(tmp_path, lines=np.ones((16, 5), np.float32), theta=np.arange(5.0)))
    lines = np.ones((6, 8), np.float32)
    lines[2, 1] = lines[4, :2] = np.nan
    with pytest.raises(UserError, match=r"3 values that are NaN or infinite, in 2 of 6 rows \(row 2 is the first\)"):
        read(saved(tmp_path, lines=lines))


@pytest.mark.parametrize(("name", "spelling"), [("azimuth", "azimuths"), ("angle", "angles"), ("angle", "theta")])
def test_known_views_in_other_spellings_are_not_ignored(tmp_path, name, spelling):
    data = {"lines": np.ones((3, 8), np.float32)} if name == "angle" else {"sil": masks}
    found = read(saved(tmp_path, **data, **{spelling: np.arange(3.0)}))
    assert found.latents is not None and found.latents[name].tolist() == [0, 1, 2]
    with pytest.raises(UserError, match=f"`{spelling}` beside another array of the same"):
        read(saved(tmp_path, **data, **{spelling: np.arange(3.0), name: np.arange(3.0)}))


def test_arrays_beside_pictures_that_are_called_angles_are_none_of_ours(tmp_path):
    assert read(saved(tmp_path, sil=masks, angles=np.zeros((5, 3)), theta=np.arange(7.0))).latents is None


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"sil": masks.astype(complex)}, "sil: is of type complex128; save it as bool"),
        ({"sil": masks.astype(np.int64)}, "sil: is of type int64"),
        ({"sil": masks.astype(str)}, "sil: is of type <U5"),
        ({"sil": np.where(masks, np.nan, 0)}, "sil: has 144 values that are NaN"),
        ({"sil": masks * 2.0}, r"values run from 0 to 2; scale pictures and volumes to \[0, 1\]"),
        ({"sil": masks - 0.5}, "values run from -0.5"),
        ({"sil": masks[0]}, r"sil: is of shape \(20, 20\)"),
        ({"sil": np.zeros((0, 8, 8))}, "is empty"),
        ({"volume": masks}, r"volumes are \(N, X, Y, Z\)"),
        ({"volume": np.zeros((2, 8, 8, 9))}, "X = Y = Z"),
        ({"label": np.arange(3)}, "none could be the data"),
        ({"sil": masks, "volume": np.zeros((3, 8, 8, 8))}, "several could be the data"),
        ({"sil": np.array([masks, None], dtype=object)}, "Python objects, which are never loaded"),
        ({}, "holds nothing"),
    ],
)
def test_wrong_arrays_say_what_to_mend(tmp_path, arrays, message):
    with pytest.raises(UserError, match=message):
        read(saved(tmp_path, **arrays))


def test_truncated_and_foreign_files(tmp_path):
    path = saved(tmp_path, sil=masks)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(UserError, match=r"x\.npz: is damaged or of another format"):
        read(path)
    np.save(tmp_path / "y.npy", masks)
    (tmp_path / "y.npy").write_bytes((tmp_path / "y.npy").read_bytes()[:-100])
    (tmp_path / "words.txt").write_text("hello")
    for name in ("y.npy", "words.txt"):
        with pytest.raises(UserError, match="is damaged or of another format"):
            read(tmp_path / name)


def test_idx_files_gzipped_or_not(tmp_path):
    digits = np.random.default_rng(0).integers(0, 256, (5, 28, 28), dtype=np.uint8)
    raw = b"\0\0\x08\x03" + struct.pack(">III", 5, 28, 28) + digits.tobytes()
    (tmp_path / "a-idx3-ubyte").write_bytes(raw)
    (tmp_path / "a-idx3-ubyte.gz").write_bytes(gzip.compress(raw))
    for name in ("a-idx3-ubyte", "a-idx3-ubyte.gz"):
        assert np.allclose(read(tmp_path / name).floats()[:, 0], digits / 255)
    (tmp_path / "a-idx3-ubyte").write_bytes(raw[:-9])
    with pytest.raises(UserError, match="announces 5 x 28 x 28 values and holds 3911"):
        read(tmp_path / "a-idx3-ubyte")


@settings(max_examples=80, deadline=None)
@given(
    place=st.integers(0, 10**6), value=st.integers(0, 255), kept=st.floats(0, 1), suffix=st.sampled_from(["npz", "npy"])
)
def test_a_damaged_file_is_read_or_refused_and_nothing_else(tmp_path_factory, place, value, kept, suffix):
    path = tmp_path_factory.mktemp("damage") / f"x.{suffix}"
    np.savez(path, sil=masks) if suffix == "npz" else np.save(path, masks)
    damaged = bytearray(path.read_bytes())
    damaged[place % len(damaged)] = value
    path.write_bytes(damaged if kept > 0.5 else damaged[: int(2 * kept * len(damaged))])
    try:
        assert len(read(path)) >= 1
    except UserError as error:
        assert str(path) in str(error)


def test_lines_are_of_any_type_of_number(tmp_path):
    small = np.array([[0, 7], [5, 90]], np.uint8)
    for values in (small, np.array([[0, 900]]), np.array([[-0.5, 7.25]]), np.array([[0, 65535]], np.uint16)):
        found = read(saved(tmp_path, lines=values))
        assert np.allclose(found.floats()[:, 0], values) and found.shape == (1, 2)


def test_sinograms_are_lines_of_each_object(tmp_path):
    sinograms, angle = np.random.default_rng(0).random((3, 5, 4)), np.array([0.0, 0.5, 1.0, 1.5])
    found = read(saved(tmp_path, sinograms=sinograms, angle=angle))
    assert len(found) == 12 and found.shape == (1, 5) and found.names[5] == "00001#1"
    assert np.allclose(found.floats()[5, 0], sinograms[1, :, 1])
    assert found.latents is not None and torch.equal(found.latents["angle"], torch.from_numpy(angle).float().repeat(3))
    kept, held_out = found.split(0.1)
    assert not {n.split("#")[0] for n in kept.names} & {n.split("#")[0] for n in held_out.names}
    one = read(saved(tmp_path, sinogram=sinograms[1]))
    assert torch.equal(one.floats(), found.floats()[4:8]) and one.latents is None
    with pytest.raises(UserError, match="angle: is .* for each of 4"):
        read(saved(tmp_path, sinograms=sinograms, angle=angle[:3]))
    with pytest.raises(UserError, match=r"sinograms are \(M, D, A\)"):
        read(saved(tmp_path, sinograms=sinograms[None]))


def test_lines_of_one_object_are_held_out_together_by_their_names(tmp_path):
    names = [f"scan{i // 4}#{i % 4}" for i in range(48)]
    found = read(saved(tmp_path, lines=np.ones((48, 8)), names=np.array(names)))
    assert found.names == tuple(names)
    kept, held_out = found.split(0.1)
    assert not {n.split("#")[0] for n in kept.names} & {n.split("#")[0] for n in held_out.names}
    named = read(saved(tmp_path, sinograms=np.ones((2, 8, 3)), names=np.array(["left", "right"])))
    assert named.names == ("left#0", "left#1", "left#2", "right#0", "right#1", "right#2")
    assert read(saved(tmp_path, lines=np.ones((2, 8)), names=np.array(["one"]))).names == ("00000", "00001")


def test_degrees_are_recognised_and_said(tmp_path):
    degrees = np.array([0, 90, 179])
    with pytest.warns(UserWarning, match="angle from 0 to 179: looks like degrees and is taken so"):
        found = read(saved(tmp_path, lines=np.ones((3, 8)), angle=degrees))
    assert found.latents is not None and np.allclose(found.latents["angle"], np.deg2rad(degrees))
    with pytest.warns(UserWarning, match="azimuth from -170 to 10, elevation from 0 to 5: looks like degrees"):
        found = read(saved(tmp_path, masks=masks, azimuth=np.array([-170.0, 0, 10]), elevation=np.array([0.0, 5, 5])))
    assert found.latents is not None and np.allclose(found.latents["elevation"], np.deg2rad([0, 5, 5]))
    turns = np.array([0, 2 * np.pi, 4 * np.pi])
    found = read(saved(tmp_path, lines=np.ones((3, 8)), angle=turns))
    assert found.latents is not None and np.allclose(found.latents["angle"], turns)


def blocks(count: int = 5, dtype: Any = np.uint8, high: int = 255) -> np.ndarray:
    masks = np.zeros((count, 16, 16), dtype)
    for k in range(count):
        masks[k, 4:11, 3 + k : 9 + k] = high
    return masks


@pytest.mark.parametrize("suffix", ["npz", "npy"])
@pytest.mark.parametrize("dtype, high", [(np.uint8, 255), (np.uint8, 1), (bool, 1), (np.float32, 1)])
def test_dark_masks_on_a_light_ground_are_inverted(tmp_path: Path, suffix: str, dtype: Any, high: int) -> None:
    path, masks = tmp_path / f"masks.{suffix}", blocks(dtype=dtype, high=high)
    inverted = ~masks if dtype is bool else high - masks
    np.savez(path, masks=inverted) if suffix == "npz" else np.save(path, inverted)
    with pytest.warns(UserWarning, match="most masks are bright along their border"):
        found = Collection.silhouettes(path)
    assert torch.equal(found.floats()[:, 0] > 0.5, torch.from_numpy(masks > 0))
    assert Collection.images(path).floats()[:, 0, 0, 0].eq(1).all()  # pictures as they are


@pytest.mark.parametrize("suffix", ["npz", "npy"])
@pytest.mark.parametrize("channels", [3, 4])
def test_grey_pictures_of_several_channels_are_masks(tmp_path: Path, suffix: str, channels: int) -> None:
    path, masks = tmp_path / f"masks.{suffix}", blocks()
    masks[2] = 0
    inverted = np.stack([255 - masks] * 3 + [np.full_like(masks, 255)], -1)[..., :channels]
    np.savez(path, masks=inverted) if suffix == "npz" else np.save(path, inverted)
    with pytest.warns(UserWarning, match="most masks are bright along their border"):
        found = Collection.silhouettes(path)
    assert [name for name, _ in found.skipped] == ["00002"]
    assert torch.equal(found.floats()[:, 0] > 0.5, torch.from_numpy(np.delete(masks, 2, 0) > 0))


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("dtype", [bool, np.uint8, np.float32])
def test_masks_of_any_shape_stay_as_stored_in_their_file_too(tmp_path: Path, dtype: Any, dark: bool) -> None:
    """Those that are mapped were padded to a square, so that they were others than those that are read."""
    stored = np.zeros((4, 12, 16), dtype)
    stored[:, 2:8, 3:9] = 1
    stored = (1 - stored.astype(np.int8)).astype(dtype) if dark else stored
    np.save(tmp_path / "x.npy", stored)
    np.savez(tmp_path / "x.npz", masks=stored)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        mapped, taken = (Collection.silhouettes(tmp_path / f"x.{suffix}") for suffix in ("npy", "npz"))
    assert mapped.shape == taken.shape == (1, 12, 16)
    assert torch.equal(mapped.floats(), taken.floats()) and mapped.floats().mean() == pytest.approx(36 / 192)


@pytest.mark.parametrize("high", [1, 20, 127])
def test_labels_are_masks(tmp_path: Path, high: int) -> None:
    np.savez(tmp_path / "labels.npz", masks=blocks(high=high))
    assert Collection.silhouettes(tmp_path / "labels.npz").floats().unique().tolist() == [0, 1]
    grey = blocks(high=high)
    grey[0, 5, 5] = high // 2 + (high == 1)
    assert Collection(grey).white == (1 if high == 1 else 255)


@pytest.mark.parametrize("suffix", ["npz", "npy"])
def test_labels_with_a_void_are_no_masks(tmp_path: Path, suffix: str) -> None:
    """Their contours were objects, with 6 % inside, and those without a void were empty."""
    labels = np.zeros((4, 16, 16), np.uint8)
    labels[:2, 3:12, 3:12], labels[:, 4:11, 4:11] = 255, 15
    path = tmp_path / f"voc.{suffix}"
    np.savez(path, masks=labels) if suffix == "npz" else np.save(path, labels)
    with pytest.raises(UserError, match="holds labels up to 15 and 255, as segmentations mark what is void"):
        Collection.silhouettes(path)
    assert Collection.images(path).floats()[0, 0, 8, 8] == pytest.approx(15 / 255)
    soft = blocks()
    soft[:, 4] = 12
    np.savez(tmp_path / "soft.npz", masks=soft)
    assert len(Collection.silhouettes(tmp_path / "soft.npz")) == 5


@pytest.mark.parametrize("suffix", ["npz", "npy"])
def test_values_of_arrays_stay_when_they_are_averaged(tmp_path: Path, suffix: str) -> None:
    """Of pictures in a folder two values are a mask, and faint ones beside a bright one are labels."""
    soft = np.zeros((3, 16, 16), np.float32)
    soft[0, 4:12, 4:12], soft[1, 2:14, 4:12], soft[1, 2:14, 7:9], soft[2, 4:12, 4:12] = 0.75, 0.0625, 1, 1
    path = tmp_path / f"soft.{suffix}"
    np.savez(path, masks=soft) if suffix == "npz" else np.save(path, soft)
    found = Collection.silhouettes(path, 8).floats()[:, 0]
    assert torch.equal(found, torch.from_numpy(soft).unflatten(1, (8, 2)).unflatten(3, (8, 2)).mean((2, 4)))


def test_masks_that_show_nothing_are_left_out(tmp_path: Path) -> None:
    masks = blocks()
    masks[[1, 3]] = 0
    np.savez(tmp_path / "some.npz", masks=masks, azimuth=np.arange(5) / 10)
    found = Collection.silhouettes(tmp_path / "some.npz")
    assert found.names == ("00000", "00002", "00004") and [name for name, _ in found.skipped] == ["00001", "00003"]
    assert found.latents is not None and found.latents["azimuth"].tolist() == pytest.approx([0, 0.2, 0.4])
    np.savez(tmp_path / "none.npz", masks=0 * masks)
    with pytest.raises(UserError, match="no picture has anything above 0.5"):
        Collection.silhouettes(tmp_path / "none.npz")


@pytest.mark.parametrize("dtype", [bool, np.uint8, np.float32])
def test_volumes_without_a_voxel_are_left_out(tmp_path: Path, dtype: Any) -> None:
    volumes = np.zeros((4, 6, 6, 6), dtype)
    volumes[[0, 2], 2:4, 2:4, 2:4] = 1
    path = saved(tmp_path, volume=volumes, names=["a", "b", "c", "d"])
    for found in (read(path), Collection.volumes(path, 12)):
        assert found.names == ("a", "c") and [name for name, _ in found.skipped] == ["b", "d"]
        assert (found.floats().flatten(1).sum(1) >= 8).all()
    with pytest.raises(UserError, match="no volume has an occupied voxel"):
        read(saved(tmp_path, volume=np.zeros_like(volumes)))


def solids(count: int = 4) -> np.ndarray:
    """Return blocks amid grids (N, 8, 8, 8), no two alike."""
    volumes = np.zeros((count, 8, 8, 8), np.uint8)
    for k in range(count):
        volumes[k, 2:6, 1 : 4 + k, 2:6] = 1
    return volumes


@pytest.mark.parametrize("change", [lambda x: x * np.arange(1, 9, dtype=np.uint8), lambda x: x * np.float32(0.1)])
def test_volumes_of_labels_or_of_faint_values_are_refused(tmp_path: Path, change: Any) -> None:
    with pytest.raises(UserError, match=r"values are (6 of 255|0.1 of 1) at most; of labels save volumes > 0"):
        read(saved(tmp_path, volumes=change(solids())))
    if change(solids()).dtype == np.float32:
        some = solids().astype(np.float32)
        some[1] *= 0.1
        assert [name for name, _ in read(saved(tmp_path, volumes=some)).skipped] == ["00001"]


def test_volumes_that_are_full_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="all voxels of all volumes are occupied; volumes are 1 inside, 0 outside"):
        read(saved(tmp_path, volumes=np.ones((3, 8, 8, 8), bool)))
    blocks = solids()
    blocks[:3] = 1  # cubes among other objects
    assert len(read(saved(tmp_path, volumes=blocks))) == 4


@pytest.mark.parametrize("white", [np.bool_(1), np.uint8(1), np.uint8(255), np.float32(1)])
def test_volumes_cut_out_of_blocks_are_inverted_with_a_warning(tmp_path: Path, white: Any) -> None:
    inverted = (1 - solids()) * white
    inverted[3] = white  # a block among them is nothing then
    with pytest.warns(UserWarning, match="most volumes are occupied along their outer faces"):
        found = read(saved(tmp_path, volumes=inverted))
    assert np.array_equal(found.floats(), solids()[:3]) and [name for name, _ in found.skipped] == ["00003"]
    touching = solids()
    touching[:, 0] = touching[:, -1] = touching[:, :, 0] = touching[:, :, :, 0] = 1
    assert np.array_equal(read(saved(tmp_path, volumes=touching)).floats(), touching)  # no warning, an error here


@pytest.mark.parametrize("name", ["masks", "volume"])
def test_strict_reading_of_arrays_refuses_what_is_empty(tmp_path: Path, name: str) -> None:
    x = np.ones((3, 8, 8, 8) if name == "volume" else (3, 8, 8), bool)
    x[1] = False
    assert len(read(saved(tmp_path, **{name: x}))) == 2
    with pytest.raises(UserError, match="item 1: empty: no .* leave out --strict"):
        read(tmp_path / "x.npz", strict=True)


@pytest.mark.parametrize("form", ["mapped", "mapped and inverted", "cut-outs", "mapped cut-outs", "framed"])
def test_what_shows_nothing_is_left_out_however_it_is_stored(tmp_path: Path, form: str) -> None:
    masks = blocks().repeat(2, 1).repeat(2, 2)  # objects that are large enough to be framed
    masks[[1, 3]] = 0
    stored = np.stack([masks // 2 + 100] * 3 + [masks], -1) if "cut-outs" in form else masks
    stored = 255 - stored if "inverted" in form else stored
    file = tmp_path / ("some.npy" if "mapped" in form else "some.npz")
    names = [f"cat{k}" for k in range(5)]
    np.save(file, stored) if "mapped" in form else np.savez(file, masks=stored, names=names)
    with warnings.catch_warnings(record=True):
        warnings.simplefilter("always")
        found = Collection.silhouettes(file, **({"framing": Framing()} if form == "framed" else {}))
    name = "{:05d}" if "mapped" in form else "cat{}"
    assert found.names == tuple(name.format(k) for k in (0, 2, 4))
    assert [skipped for skipped, _ in found.skipped] == [name.format(k) for k in (1, 3)]
    assert found.floats().flatten(1).amax(1).min() > 0.5


def test_colour_pictures_are_no_masks(tmp_path: Path) -> None:
    colours = np.random.default_rng(0).integers(0, 255, (4, 16, 16, 3), dtype=np.uint8)
    np.savez(tmp_path / "colours.npz", images=colours)
    with pytest.raises(UserError, match="images: colour pictures are no masks; give masks, alpha"):
        Collection.silhouettes(tmp_path / "colours.npz")
    np.savez(tmp_path / "grey.npz", images=blocks()[..., None].repeat(3, 3))
    assert Collection.silhouettes(tmp_path / "grey.npz").shape == (1, 16, 16)
    cut_out = np.concatenate([colours, blocks(4)[..., None]], 3)
    np.savez(tmp_path / "alpha.npz", images=cut_out)
    found = Collection.silhouettes(tmp_path / "alpha.npz").floats()[:, 0]
    assert torch.equal(found, torch.from_numpy(blocks(4)) / 255)


def test_the_number_of_masks_comes_first(tmp_path: Path) -> None:
    np.savez(tmp_path / "last.npz", masks=blocks(9).transpose(1, 2, 0))
    for read_as in (Collection.silhouettes, Collection.images):
        with pytest.warns(
            UserWarning, match=r"\(16, 16, 9\) is taken for 16 pictures of 9 x 16 pixels; .*transpose\(2"
        ):
            read_as(tmp_path / "last.npz")
    np.save(tmp_path / "one.npy", np.ones((12, 16, 3), np.uint8))
    with pytest.warns(UserWarning, match=r"12 pictures of 3 x 16 pixels; if it is one picture .* array\[None\]"):
        Collection.images(tmp_path / "one.npy")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(Collection.images(saved(tmp_path, images=blocks(16)))) == 16


def test_a_folder_is_no_file_of_arrays(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="is a folder; name a file of arrays in it"):
        Collection.lines(tmp_path)


def test_sinograms_in_another_order_of_axes_are_said(tmp_path: Path) -> None:
    """From every angle the sum over detectors is the object's mass."""
    detector, angle = np.linspace(-1, 1, 16)[:, None], np.linspace(0, np.pi, 12, endpoint=False)
    one = np.exp(-((detector - 0.4 * np.cos(angle)) ** 2) / 0.02).astype(np.float32)
    sinograms = np.stack([one, one[::-1]])
    np.savez(tmp_path / "right.npz", sinograms=sinograms)
    assert Collection.lines(tmp_path / "right.npz").shape == (1, 16)
    np.savez(tmp_path / "wrong.npz", sinograms=sinograms.swapaxes(1, 2))
    with pytest.warns(UserWarning, match=r"sinograms are \(M, D, A\), detectors by angles; if this is \(M, A, D\)"):
        Collection.lines(tmp_path / "wrong.npz")


@pytest.mark.parametrize(
    ("azimuth", "elevation", "why"),
    [(1e300, 0.0, r"azimuth: has 1e\+300; give angles"), (0.5, 2.0, "114.592 degrees is beyond a pole")],
)
def test_what_is_no_angle_is_refused(tmp_path: Path, azimuth: float, elevation: float, why: str) -> None:
    known = {"azimuth": np.full(3, azimuth), "elevation": np.full(3, elevation)}
    np.savez(tmp_path / "m.npz", sil=np.ones((3, 8, 8), bool), **known)
    with pytest.raises(UserError, match=why):
        Collection.silhouettes(tmp_path / "m.npz")
