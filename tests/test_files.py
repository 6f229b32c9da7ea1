"""`atomic_path`: whole or not at all."""

from __future__ import annotations

import errno
import os
import stat

import pytest

from unproject import _files
from unproject._files import atomic_path
from unproject._types import UserError


def test_writes_and_creates_parents(tmp_path):
    final = tmp_path / "a" / "b" / "shape.glb"
    with atomic_path(final) as tmp:
        assert tmp.parent == final.parent and tmp.suffix == ".glb" and tmp != final
        tmp.write_bytes(b"new")
        assert not final.exists()
    assert final.read_bytes() == b"new"
    assert os.listdir(final.parent) == ["shape.glb"]


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left on device"), KeyboardInterrupt()])
def test_a_failing_writer_leaves_what_was_there(tmp_path, error):
    final = tmp_path / "weights.safetensors"
    final.write_bytes(b"old")
    with pytest.raises(type(error)), atomic_path(final) as tmp:
        tmp.write_bytes(b"ha")
        raise error
    assert final.read_bytes() == b"old"
    assert os.listdir(tmp_path) == [final.name]


def test_a_disk_that_fails_at_synchronisation_leaves_nothing(tmp_path, monkeypatch):
    def full(path):
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(_files, "_synchronise", full)
    with pytest.raises(OSError, match="No space"), atomic_path(tmp_path / "x.npz") as tmp:
        tmp.write_bytes(b"x")
    assert os.listdir(tmp_path) == []


def test_a_writer_that_writes_nothing_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "x.npz"):
        pass
    assert os.listdir(tmp_path) == []


def test_the_parent_may_not_be_a_file(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError), atomic_path(tmp_path / "file" / "x.npz"):
        pass


def test_a_folder_of_that_name_is_not_replaced(tmp_path):
    (tmp_path / "x.npz").mkdir()
    with pytest.raises(OSError), atomic_path(tmp_path / "x.npz") as tmp:
        tmp.write_bytes(b"x")
    assert os.listdir(tmp_path) == ["x.npz"]


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes in folders")
def test_devices_and_pipes_are_not_replaced(tmp_path):
    """A root user who wrote to /dev/null would leave all programs a file there."""
    pipe, link = tmp_path / "pipe.png", tmp_path / "link.png"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    for final in (pipe, link):
        with pytest.raises(UserError, match="device; give the name of a file"), atomic_path(final) as tmp:
            tmp.write_bytes(b"new")
    assert stat.S_ISFIFO(pipe.stat().st_mode) and sorted(os.listdir(tmp_path)) == ["link.png", "pipe.png"]
