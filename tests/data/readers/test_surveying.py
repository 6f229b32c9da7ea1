"""Folders are read on all cores, to the same pictures in the same order."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from unproject._pictures import UnusablePicture
from unproject._types import UserError
from unproject.data import Collection
from unproject.data.readers import surveying
from unproject.data.readers.surveying import Item, survey

COUNT = 24


@pytest.fixture
def masks(tmp_path: Path) -> Path:
    """Boxes of different sizes, and one file that is no picture."""
    for number in range(COUNT):
        picture = np.zeros((40, 40), np.uint8)
        picture[4 : 14 + number, 6:20] = 255
        Image.fromarray(picture).save(tmp_path / f"{number:02d}.png")
    (tmp_path / "07.png").write_bytes(b"no picture")
    return tmp_path


@pytest.fixture
def two_workers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(surveying, "MIN_FOR_WORKERS", 1)
    monkeypatch.setattr(surveying, "cores", lambda: 2)


@pytest.mark.parametrize("system", ["linux", "other"])
def test_workers_find_what_one_process_finds(
    masks: Path, two_workers: None, monkeypatch: pytest.MonkeyPatch, system: str
) -> None:
    if system == "linux" and sys.platform != "linux":
        pytest.skip("processes are forked on Linux only")
    monkeypatch.setattr(surveying.sys, "platform", system)
    several = Collection.silhouettes(masks, 16)
    monkeypatch.setattr(surveying, "cores", lambda: 1)
    alone = Collection.silhouettes(masks, 16)
    assert several.names == alone.names and several.skipped == alone.skipped and torch.equal(several.items, alone.items)
    assert len(several) == COUNT - 1 and several.skipped[0][0] == "07.png"
    assert not torch.equal(several.items[0], several.items[1])


def test_strict_reports_what_a_worker_finds(masks: Path, two_workers: None) -> None:
    with pytest.raises(UserError, match=r"07\.png: unreadable: no picture of a known format"):
        Collection.silhouettes(masks, 16, strict=True)


KILLED = """
import os, sys, time
from pathlib import Path
from unproject.data.readers import surveying

def read(file):
    os.write(1, f"{os.getpid()}\\n".encode())
    time.sleep(60)

surveying.MIN_FOR_WORKERS, surveying.cores = 1, lambda: 2
list(surveying.items_of([Path("a")] * 64, read, False))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="processes are forked on Linux only")
def test_workers_end_with_a_process_that_is_killed(forked: None) -> None:
    with subprocess.Popen([sys.executable, "-c", KILLED], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        workers = [int(parent.stdout.readline()) for _ in range(2)]
        parent.send_signal(signal.SIGKILL)
        parent.stdout.close()
    until = time.monotonic() + 50  # they would sleep for 60
    while any(map(_runs, workers)) and time.monotonic() < until:
        time.sleep(0.1)
    assert not any(map(_runs, workers))


def _runs(process: int) -> bool:
    """Whether it is there, and not only waiting for somebody to ask how it ended."""
    stat = Path(f"/proc/{process}/stat")
    try:
        return stat.read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def test_a_worker_that_is_killed_is_said(tmp_path: Path, two_workers: None) -> None:
    """As the system kills what takes too much memory; nothing waits for it."""
    files = [tmp_path / f"{k}.png" for k in range(300)]

    def deadly(file: Path) -> Item:
        if file.stem == "150":
            os.kill(os.getpid(), signal.SIGKILL)
        raise UnusablePicture("nothing")

    with pytest.raises(UserError, match="a process that reads pictures was killed"):
        survey(tmp_path, files, deadly, strict=False)
