"""Kill the packing of a folder by SIGKILL ten times or more, and finish it: `python killed_packs.py FOLDER OUT SEED`.

A script of its own, because forking a process that has just imported torch is clean and quick, and forking pytest is
neither. Prints how many parts were there after each kill, and goes on until some kill came amid the parts.
"""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from pathlib import Path

import torch

from unproject.data import ReadOptions, pack
from unproject.data import packing as packing_module
from unproject.data.readers import surveying

KILLS, WHOLE = 10, 15
"""Kills at least, and parts of the whole folder."""
HOW = ReadOptions(16)


def killed_after(seconds: float, folder: Path, out: Path) -> bool:
    """Whether SIGKILL came before the end."""
    child = os.fork()
    if child == 0:
        pack(folder, out, HOW)
        os._exit(0)
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    status = os.waitpid(child, 0)[1]
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0, "packing failed by itself"
    return os.WIFSIGNALED(status)


def main(folder: Path, out: Path, seed: int) -> None:
    torch.set_num_threads(1)
    packing_module.FILES_PER_PART, surveying.MIN_FOR_WORKERS, surveying.AT_ONCE = 4, 1, 2
    surveying.cores = lambda: 2
    pack(folder, out.with_name("warm.npz"), HOW)  # what is slow once only would spoil the measure of time
    began = time.monotonic()
    pack(folder, out.with_name("whole.npz"), HOW)
    longest = (time.monotonic() - began) / 2
    rng, parts, number = random.Random(seed), [], 0
    while len(parts) < KILLS or not any(0 < count < WHOLE for count in parts):
        if killed_after(rng.uniform(0, longest), folder, out.with_name(f"killed-{number}.npz")):
            parts.append(len(list(out.parent.glob(f".killed-{number}.npz.*.parts/[0-9]*.npz"))))
            longest *= 1 if parts[-1] else 1.2  # the machine may be busier by now than when it was measured
            print(parts[-1])
        else:
            number += 1
    pack(folder, out.with_name(f"killed-{number}.npz"), HOW)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]))
