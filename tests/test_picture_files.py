"""Pictures in floating point and 16 bits come back as they were, and damaged ones are one line."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from unproject._pictures import UnusablePicture, read_displayed, read_stored, write_picture
from unproject._silence import silenced
from unproject._types import UserError

PIXELS = np.random.default_rng(0).random((33, 20, 3)).astype(np.float32)
KINDS = [("png", "uint8", 1 / 500), ("png", "uint16", 1 / 130000), ("exr", "half", 3e-4), ("exr", "float", 0)]


@pytest.mark.parametrize("suffix, depth, tolerance", [*KINDS, ("hdr", "float", 4e-3)])
def test_what_is_written_is_read(tmp_path: Path, suffix: str, depth: str, tolerance: float) -> None:
    path = tmp_path / f"a.{suffix}"
    write_picture(path, PIXELS, depth)  # pyright: ignore[reportArgumentType]
    pixels, stored = read_stored(path)
    assert stored == depth
    assert np.abs(pixels - PIXELS).max() <= tolerance
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize("suffix, orientation", [*(("jpg", n) for n in range(1, 9)), ("tif", 6), ("png", 8)])
def test_pictures_are_turned_as_their_camera_says(tmp_path: Path, suffix: str, orientation: int) -> None:
    from PIL import Image, ImageOps

    exif = Image.Exif()
    exif[0x0112] = orientation
    smooth = np.add.outer(np.arange(33) * 5, np.arange(20) * 2)[..., None] + np.zeros(3)
    Image.fromarray(smooth.astype(np.uint8)).save(tmp_path / f"a.{suffix}", exif=exif)
    with Image.open(tmp_path / f"a.{suffix}") as picture:
        upright = np.asarray(ImageOps.exif_transpose(picture)) / 255
    pixels = read_stored(tmp_path / f"a.{suffix}").pixels
    assert pixels.shape == upright.shape
    assert np.abs(pixels - upright).max() < 0.02


@pytest.mark.parametrize("mode", ["L", "RGB", "RGBA", "P", "I;16"])
@pytest.mark.parametrize("orientation", [5, 6, 7, 8])
def test_a_turned_tiff_is_displayed_upright(tmp_path: Path, mode: str, orientation: int) -> None:
    """Which Pillow maps into memory at the size that it has when it is turned."""
    from PIL import Image, ImageOps

    exif = Image.Exif()
    exif[0x0112] = orientation
    picture = Image.fromarray(np.add.outer(np.arange(12) * 9, np.arange(20) * 5).astype(np.uint8)).convert(mode)
    picture.save(tmp_path / "a.tif", exif=exif)
    picture.save(tmp_path / "a.png", exif=exif)
    with Image.open(tmp_path / "a.png") as stored:
        upright = np.asarray(ImageOps.exif_transpose(stored.convert("I" if mode == "I;16" else "RGB")))
    found = read_displayed(tmp_path / "a.tif")
    assert found.shape[:2] == (20, 12) == upright.shape[:2]
    whole = 1 if mode != "I;16" else 65535
    assert np.abs(found[..., 0] * whole - upright.reshape(20, 12, -1)[..., 0]).max() < 1


def test_one_channel(tmp_path: Path) -> None:
    write_picture(tmp_path / "a.png", PIXELS[..., 0], "uint16")
    assert read_stored(tmp_path / "a.png").pixels.shape == (33, 20, 1)


@pytest.mark.parametrize("suffix, depth", [("png", "uint8"), ("exr", "float"), ("hdr", "float")])
def test_half_a_file_is_refused(tmp_path: Path, suffix: str, depth: str, capfd: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / f"a.{suffix}"
    write_picture(path, PIXELS, depth)  # pyright: ignore[reportArgumentType]
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(UserError, match="a\\."):
        read_stored(path)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("channels, depth", [(3, "float"), (3, "half"), (4, "float")])
def test_a_tiff_of_floats_in_colour_is_read_as_stored(
    tmp_path: Path, channels: int, depth: Literal["half", "float"], capfd: pytest.CaptureFixture[str]
) -> None:
    """Pillow does not identify it."""
    path, pixels = tmp_path / "a.tif", np.linspace(0, 1, 33 * 20 * channels, dtype=np.float32).reshape(33, 20, channels)
    write_picture(path, pixels, depth)
    assert np.abs(read_stored(path).pixels - pixels).max() < 1e-3
    with pytest.raises(UnusablePicture, match="^holds floats in colour; save it as 8 or 16 bits"):
        read_displayed(path)
    for content in (path.read_bytes()[: path.stat().st_size // 2], b"II*\0text"):
        path.write_bytes(content)
        with pytest.raises(UserError, match=r"a\.tif"):
            read_stored(path)
        with pytest.raises(UnusablePicture):
            read_displayed(path)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("content", [b"", b"text", b"#?RADIANCE\n", b"\x76\x2f\x31\x01" + b"0" * 99])
@pytest.mark.parametrize("suffix", ["png", "exr", "hdr"])
def test_what_is_no_picture_is_refused(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"a.{suffix}"
    path.write_bytes(content)
    with pytest.raises(UserError, match="a\\."):
        read_stored(path)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such file"):
        read_stored(tmp_path / "a.exr")
    with pytest.raises(UserError, match="give a name"):
        write_picture(tmp_path / "a.txt", PIXELS, "float")


def test_threads_that_silence_stderr_give_it_back() -> None:
    """The first that comes turns it off, the last that leaves on, in any order."""
    before, one, two = os.readlink("/proc/self/fd/2"), silenced(), silenced()
    one.__enter__()
    two.__enter__()
    assert os.readlink("/proc/self/fd/2") == os.devnull
    one.__exit__(None, None, None)
    assert os.readlink("/proc/self/fd/2") == os.devnull
    two.__exit__(None, None, None)
    assert os.readlink("/proc/self/fd/2") == before
