"""Damaged and hostile files, each read in a child process: one line and status 2, in little memory and time."""

from __future__ import annotations

import gzip
import io
import os
import resource
import shutil
import signal
import struct
import sys
import time
import warnings
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from unproject._pictures import write_picture
from unproject.cli import main
from unproject.cli._machine import return_memory

GIB = 2**30
Line = Callable[..., str]


def in_child(argv: list[str], errors: Path, memory: int = GIB, seconds: int = 60) -> int:
    """The exit status of a command in a forked child that may take so much more memory than this process has.

    And so many seconds of a processor; by the clock it may take four times as many, on a busy machine.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # threads of this process, which the child does not use
        child = os.fork()
    if not child:
        status = 99
        try:
            with errors.open("wb") as stream:
                os.dup2(stream.fileno(), 2)
            sys.stderr = os.fdopen(2, "w", buffering=1, closefd=False)
            sys.stdout = io.StringIO()
            return_memory()  # from now on a large block is new, and none that this process has left free
            now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
            resource.setrlimit(resource.RLIMIT_AS, (now + memory, now + memory))
            resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
            torch.set_num_threads(1)  # threads that this process has begun do not survive a fork
            sys.argv = ["unproject", *argv]
            status = main()
        except BaseException as error:
            sys.stderr.write(f"{type(error).__name__}: {error}\n")
        finally:
            sys.stderr.flush()
            os._exit(status)
    for _ in range(4 * seconds * 20):
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.05)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    raise AssertionError(f"{argv} hangs")


@pytest.fixture(scope="module", autouse=True)
def imported(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Import here, once, what each forked child would import: the commands do so when they are called."""
    nowhere = str(tmp_path_factory.mktemp("nowhere") / "x.npz")
    for words in (["data", "inspect"], ["export", "--out", "x.png"], ["render", "--out", "x.png"]):
        assert main([*words, nowhere]) == 2


@pytest.fixture
def refused(tmp_path: Path) -> Line:
    """Run a command that must be refused in one line; the line."""

    def call(*argv: str | Path) -> str:
        status = in_child([str(word) for word in argv], tmp_path / "stderr")
        err = (tmp_path / "stderr").read_text()
        assert status == 2 and err.startswith("unproject: ") and err.count("\n") == 1 and err[:-1].isprintable(), (
            status,
            err,
        )
        return err

    return call


# Archives that announce more than they hold, or hold more than anybody wants


def archive(path: Path, *compression: int, **members: bytes) -> Path:
    with zipfile.ZipFile(path, "w", *(compression or [zipfile.ZIP_DEFLATED])) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return path


def npy(shape: tuple[int, ...], content: bytes | None = None, kind: str = "|u1") -> bytes:
    head = io.BytesIO()
    np.lib.format.write_array_header_1_0(head, {"descr": kind, "fortran_order": False, "shape": shape})
    return head.getvalue() + (bytes(int(np.prod(shape))) if content is None else content)


@pytest.fixture(scope="module")
def bomb(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An .npz of a few MiB that holds two GiB."""
    path = tmp_path_factory.mktemp("bomb") / "x.npz"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file,
        file.open("extra.npy", "w", force_zip64=True) as stream,
    ):
        stream.write(npy((32768, 256, 256), b""))
        for _ in range(2048):
            stream.write(bytes(2**20))
    return path


@pytest.mark.slow
def test_an_archive_that_holds_gigabytes(tmp_path: Path, bomb: Path, refused: Line) -> None:
    path = shutil.copy(bomb, tmp_path)
    for argv in (["data", "inspect", path], ["export", path, "--out", tmp_path / "out"]):
        refused(*argv)
    assert "announces 2048 MiB" in refused("data", "inspect", path)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_what_is_not_used_is_not_read(tmp_path: Path, bomb: Path) -> None:
    path = shutil.copy(bomb, tmp_path)
    masks = np.zeros((3, 20, 20), np.uint8)
    masks[:, 4:16, 6:10] = 1
    with zipfile.ZipFile(path, "a") as file:
        file.writestr("masks.npy", npy(masks.shape, masks.tobytes()))
    assert in_child(["data", "inspect", str(path)], tmp_path / "stderr") == 0


def large(path: Path, *shape: int) -> Path:
    """An idx file that says this shape and holds a gigabyte of zeros, in members of a MiB."""
    head = b"\0\0\x08\x03" + struct.pack(">3I", *shape)
    path.write_bytes(gzip.compress(head) + 1024 * gzip.compress(bytes(2**20)))
    return path


def test_an_idx_file_that_holds_a_gigabyte(tmp_path: Path, refused: Line) -> None:
    path = large(tmp_path / "x.idx.gz", 1024, 1024, 1024)
    assert "announces 1024 MiB" in refused("data", "inspect", path, "--for", "digits")


def test_an_idx_file_that_does_not_end(tmp_path: Path, refused: Line) -> None:
    path = large(tmp_path / "x.idx.gz", 2, 28, 28)
    assert "holds more" in refused("data", "inspect", path, "--for", "digits")


def test_a_line_of_voxels_is_no_cube_of_gigabytes(tmp_path: Path, refused: Line) -> None:
    path = tmp_path / "x.binvox"
    path.write_bytes(b"#binvox 1\ndim 3000 1 1\ndata\n" + b"\0\xff" * 11 + b"\1\xc3")
    assert "3000" in refused("data", "inspect", path) or "announces" in refused("data", "inspect", path)


# Archives that are none


def encrypted(path: Path) -> Path:
    archive(path, zipfile.ZIP_STORED, volume=npy((2, 8, 8, 8)))
    data = bytearray(path.read_bytes())
    for mark, place in ((b"PK\x03\x04", 6), (b"PK\x01\x02", 8)):
        data[data.index(mark) + place] |= 1
    path.write_bytes(data)
    return path


def unsupported(path: Path) -> Path:
    archive(path, zipfile.ZIP_STORED, volume=npy((2, 8, 8, 8)))
    data = bytearray(path.read_bytes())
    for mark, place in ((b"PK\x03\x04", 8), (b"PK\x01\x02", 10)):
        data[data.index(mark) + place] = 97
    path.write_bytes(data)
    return path


def renamed(path: Path) -> Path:
    path.write_bytes(npy((2, 8, 8, 8)))
    return path


def packed(path: Path, labels: list[int]) -> Path:
    bits = np.packbits(np.triu(np.ones((3, 8, 8, 8), np.uint8)).reshape(3, 512), axis=1)
    np.savez(path, X_train=bits, y_train=np.array(labels), shape=np.array([8, 8, 8]), class_names=np.array(["a", "b"]))
    return path


ARCHIVES: dict[str, Callable[[Path], Path]] = {
    "renamed array": renamed,
    "encrypted": encrypted,
    "unsupported compression": unsupported,
    "broken header": lambda path: archive(path, volume=b"\x93NUMPY\x01\x00v\x00{'descr': (((("),
    "endless header": lambda path: archive(path, volume=b"\x93NUMPY\x02\x00\xff\xff\xff\x7f" + b" " * 2**20),
    "negative shape": lambda path: archive(path, volume=npy((2, 8, 8, 8)).replace(b"(2, 8", b"(-2,8")),
    "text": lambda path: archive(path, volume=npy((2, 8, 8), bytes(512), "<U1")),
    "one number": lambda path: archive(path, volume=npy((), b"\1")),
    "one picture of none": lambda path: archive(path, image=npy((), b"\1")),
    "nothing": lambda path: archive(path),
    "cut": lambda path: archive(path, volume=npy((200, 8, 8, 8), bytes(7))),
    "no array": lambda path: archive(path, **{"volume.txt": b"text"}),
    "objects": lambda path: archive(path, volume=npy((1,), b"", "|O")),
    "wrong labels": lambda path: packed(path, [0, 1, 7]),
    "too few labels": lambda path: packed(path, [0, 1]),
    "negative labels": lambda path: packed(path, [0, 1, -3]),
}


@pytest.mark.parametrize("kind", ARCHIVES)
@pytest.mark.parametrize("verb", ["inspect", "inspect materials", "export", "render"])
def test_an_archive_that_is_none(tmp_path: Path, refused: Line, kind: str, verb: str) -> None:
    path, out = ARCHIVES[kind](tmp_path / "x.npz"), tmp_path / "out.png"
    if verb == "inspect":
        if kind == "renamed array":  # its content says what it is
            return
        refused("data", "inspect", path)
    elif verb == "inspect materials":
        refused("data", "inspect", path, "--for", "wood")
    else:
        refused(verb, path, *(["--to", "png"] if verb == "export" else []), "--out", out)
    assert not out.exists()


# Pipes, for which a reader would wait for ever


@pytest.mark.parametrize("name", ["b.binvox", "b.npz", "b.npy", "b.idx", "b.obj", "b.png", "b.exr"])
def test_a_pipe_is_not_waited_for(tmp_path: Path, refused: Line, name: str) -> None:
    os.mkfifo(tmp_path / name)
    for recipe in ("shapes", "digits", "wood"):
        refused("data", "inspect", tmp_path / name, "--for", recipe)
    refused("export", tmp_path / name, "--out", tmp_path / "out.png")
    refused("render", tmp_path / name, "--out", tmp_path / "out.png")


# Pictures


def mask(side: int = 64) -> np.ndarray:
    pixels = np.zeros((side, side), np.uint8)
    pixels[side // 4 : side // 2, side // 4 : -side // 4] = 255
    return pixels


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two good masks."""
    (tmp_path / "masks").mkdir()
    for name in ("a.png", "b.png"):
        Image.fromarray(mask()).save(tmp_path / "masks" / name)
    return tmp_path / "masks"


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["L", "RGBA"])
def test_a_large_picture_takes_little_memory(tmp_path: Path, folder: Path, mode: str) -> None:
    for file in folder.iterdir():
        file.unlink()
    Image.fromarray(mask(8000)).convert(mode).save(folder / "a.png", compress_level=1)
    assert in_child(["data", "inspect", str(folder)], tmp_path / "stderr") == 0, (tmp_path / "stderr").read_text()


@pytest.mark.parametrize("recipe", ["shapes", "digits", "wood"])
def test_a_strip_is_no_picture(tmp_path: Path, refused: Line, recipe: str) -> None:
    place = tmp_path / "strips" / ("top" if recipe == "wood" else "")
    place.mkdir(parents=True)
    Image.fromarray(np.tile(mask(24), (2**20 // 24, 1))).save(place / "a.png")
    assert "a.png" in refused("data", "inspect", tmp_path / "strips", "--for", recipe)


def test_a_large_picture_is_read_as_a_small_one(folder: Path) -> None:
    from unproject.data import read

    Image.fromarray(mask(64)).resize((6400, 6400), Image.Resampling.NEAREST).save(folder / "b.png", compress_level=1)
    small, large = read(folder, 32).floats()
    assert (small - large).abs().max() < 0.05


def damaged(path: Path, seed: int) -> None:
    """Twenty bytes behind the first 40 are others."""
    data, rng = bytearray(path.read_bytes()), np.random.default_rng(seed)
    for place in rng.integers(40, len(data), 20):
        data[place] = rng.integers(256)
    path.write_bytes(data)


@pytest.mark.parametrize("suffix", ["exr", "hdr", "tif", "png", "jpg", "webp"])
def test_a_damaged_picture_is_skipped(tmp_path: Path, suffix: str) -> None:
    """Whatever its reader says of it, also what is no text; nothing is written to stderr."""
    place = tmp_path / "photographs" / "top"
    place.mkdir(parents=True)
    pixels = np.random.default_rng(0).random((80, 80, 3)).astype(np.float32)
    write_picture(place / "good.png", pixels, "uint8")
    for seed in range(20):
        write_picture(place / f"{seed}.{suffix}", pixels, "float" if suffix in ("exr", "hdr") else "uint8")
        damaged(place / f"{seed}.{suffix}", seed)
    status = in_child(["data", "inspect", str(place.parent), "--for", "wood", "--size", "32"], tmp_path / "stderr")
    assert (status, (tmp_path / "stderr").read_text()) == (0, "")
    status = in_child(["data", "inspect", str(place), "--for", "digits"], tmp_path / "stderr")
    assert (status, (tmp_path / "stderr").read_text()) == (0, "")


def test_an_error_that_is_no_text(monkeypatch: pytest.MonkeyPatch) -> None:
    from unproject import _pictures

    def geterror() -> str:
        return b"\xff".decode()

    assert _pictures._said(geterror) == "damaged"


# Names


@pytest.mark.parametrize("name", [b"\xff\xfe.png", b"a\nb.png", b"\x1b[31mred.png"], ids=["no text", "lines", "colour"])
def test_names_are_printed_on_one_line(tmp_path: Path, folder: Path, name: bytes, capfd: pytest.CaptureFixture) -> None:
    (folder / "b.png").rename(folder / os.fsdecode(name))
    (folder / os.fsdecode(b"bad" + name)).write_bytes(b"no picture")
    for flags in ([], ["--json"]):
        assert in_child(["data", "inspect", str(folder), *flags], tmp_path / "stderr") == 0
        assert (tmp_path / "stderr").read_text() == ""


def test_what_is_printable() -> None:
    from unproject._types import printable

    assert printable("chaise à porteurs θ") == "chaise à porteurs θ"
    assert printable("\x1b[31m\udcff\n") == r"\x1b[31m\udcff\n"


def test_a_name_in_an_error_is_on_one_line(tmp_path: Path, refused: Line) -> None:
    path = tmp_path / os.fsdecode(b"\xff\x1b[2J\nfolder")
    assert r"\udcff\x1b[2J" in refused("data", "inspect", path)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can become somebody else")
@pytest.mark.parametrize("place", ["", "below"])
def test_a_folder_that_may_not_be_read_is_named(
    tmp_path: Path, folder: Path, refused: Line, place: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    locked = folder / place
    locked.mkdir(exist_ok=True)
    for recipe in ("shapes", "digits", "wood"):
        main(["data", "inspect", str(folder), "--for", recipe])  # somebody else may not read what is imported
    (tmp_path / "stderr").touch()
    for path in (tmp_path, tmp_path.parent, tmp_path.parent.parent):
        path.chmod(0o777)
    (tmp_path / "stderr").chmod(0o666)
    locked.chmod(0)
    monkeypatch.setattr("unproject.cli.held", unprivileged)
    for recipe in ("shapes", "digits", "wood"):
        assert "Permission denied" in refused("data", "inspect", folder, "--for", recipe)


@contextmanager
def unprivileged() -> Iterator[None]:
    os.setuid(65534)
    yield


def test_text_that_is_none(tmp_path: Path, refused: Line) -> None:
    """Strings of it would end whatever prints them."""
    masks = np.stack([mask(20)] * 2)
    names = npy((2,), b"\xff\xff\xff\x7f" * 2, "<U1")
    path = archive(tmp_path / "x.npz", masks=npy(masks.shape, masks.tobytes()), names=names)
    assert "characters that are none" in refused("data", "inspect", path)


def test_names_that_are_not_utf8(tmp_path: Path) -> None:
    """Names of a pack are bytes; those that are no text are printed escaped."""
    masks = np.stack([mask(20)] * 2)
    path = archive(tmp_path / "x.npz", masks=npy(masks.shape, masks.tobytes()), names=npy((2,), b"\xfe\xb2", "|S1"))
    assert in_child(["data", "inspect", str(path)], tmp_path / "stderr") == 0


def test_a_class_name_that_is_no_list(tmp_path: Path) -> None:
    path = packed(tmp_path / "x.npz", [0, 0, 0])
    with np.load(path) as arrays:
        np.savez(path, **{**arrays, "class_names": np.array("chair")})
    assert in_child(["data", "inspect", f"{path}:chair"], tmp_path / "stderr") == 0


def test_an_image_without_sides(tmp_path: Path, refused: Line) -> None:
    path = archive(tmp_path / "x.npz", image=npy((4,), bytes(16), "<f4"))
    assert "image is float32 (4,)" in refused("export", path, "--to", "npz", "--out", tmp_path / "out.npz")


@pytest.mark.slow
def test_many_tiny_pictures_take_no_gigabytes(tmp_path: Path) -> None:
    """Each grows to the size of the recipe: 78 MiB as they are kept, 312 MiB as floats, which are not."""
    path = archive(tmp_path / "x.npz", masks=npy((20_000, 1, 1), np.ones(20_000, np.float32).tobytes(), "<f4"))
    status = in_child(["data", "inspect", str(path)], tmp_path / "stderr", memory=370 * 2**20)
    assert status in (0, 2) and "memory" not in (tmp_path / "stderr").read_text()
