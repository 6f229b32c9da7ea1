"""A million masks against a thousand: seconds to the first step, memory, seconds of a round, steps a second.

    python benchmarks/million.py --out FOLDER                   # 1,000,000 masks of 64², 4.1 GB
    python benchmarks/million.py --out FOLDER --n 20000 --folder   # also as PNG files, packed by `unproject data pack`

Masks are silhouettes of procedural chairs from all sides, each zoomed in height and width and moved on its own, in one
array file (.npy, uint8). Each arm is a process of its own, on one thread, with `shapes` at 32³ and its default flags:

- to the first step: from before the recipe reads its data to the end of step 1, without the import of torch;
- memory: the resident set at its largest; `anonymous` is the process's own, `of files` are pages of the mapped file,
  which the system takes back when it needs them;
- steps a second: both arms in one process, in turns, in CPU seconds; rounds are measured apart from steps.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import torch
from results import origin

import unproject as up
from unproject.data import chairs
from unproject.recipes.shapes import shapes
from unproject.training.distribution import Distribution
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer

MILLION, FEW, SIZE, VOXELS = 1_000_000, 1_000, 64, 32
SHAPES, SIDES, AT_ONCE = 64, 16, 4096
TURNS, EACH = 12, 8
"""Turns of the arms, and steps of a turn."""


def masks(count: int, seed: int = 0) -> np.ndarray:
    """Return (SHAPES * SIDES, SIZE, SIZE) silhouettes that all others are made of, fewer if fewer are asked for."""
    few = max(1, min(SHAPES, -(-count // SIDES)))
    views = up.projections.azimuth_bins(SIDES, up.Silhouette(size=SIZE))
    volumes = chairs(few, SIZE // 2, seed).repeat_interleave(2, 1).repeat_interleave(2, 2).repeat_interleave(2, 3)
    return (up.data.observe(volumes, views, SIDES, seed).floats()[:, 0].numpy() * 255).round().astype(np.uint8)


def write_array(path: Path, count: int, seed: int = 0) -> Path:
    """Write masks (N, SIZE, SIZE) uint8, if they are not there."""
    if not path.exists():
        begun, rng, base = path.with_name(f".{path.name}"), np.random.default_rng(seed), masks(count, seed)
        array = np.lib.format.open_memmap(begun, "w+", np.uint8, (count, SIZE, SIZE))
        for start in range(0, count, AT_ONCE):
            n = min(AT_ONCE, count - start)
            rows, columns = (places(n, rng) for _ in range(2))
            which = rng.integers(len(base), size=n)[:, None, None]
            array[start : start + n] = base[which, rows[:, :, None], columns[:, None]]
        array.flush()
        begun.rename(path)
    return path


def places(n: int, rng: np.random.Generator) -> np.ndarray:
    """Return (n, SIZE) the row, or column, that each row of a mask shows: zoomed by 0.75 to 1, moved by 4 at most."""
    zoom, shift = rng.uniform(1.0, 1.33, (n, 1)), rng.uniform(-4, 4, (n, 1))
    middle = (SIZE - 1) / 2
    return ((np.arange(SIZE) - middle - shift) * zoom + middle).round().clip(0, SIZE - 1).astype(np.intp)


def resident() -> dict[str, float]:
    """Return MiB of the resident set now: all, the process's own, of files; and of the largest so far."""
    lines = dict(line.split(":", 1) for line in Path("/proc/self/status").read_text().splitlines())
    names = {"all": "VmRSS", "anonymous": "RssAnon", "of_files": "RssFile", "largest": "VmHWM"}
    return {name: int(lines[key].split()[0]) / 1024 for name, key in names.items()}


def trainer(data: Path, folder: Path, recorder: Recorder, steps: int) -> Trainer:
    return Trainer(shapes(data=data, size=VOXELS, steps=steps), folder, recorder, distribution=Distribution("cpu"))


class Watched:
    """A trainer whose steps and rounds are timed apart, in CPU seconds."""

    def __init__(self, one: Trainer) -> None:
        self.one = one
        self.steps: list[float] = []
        self.rounds: list[float] = []

    def step(self) -> None:
        (state,) = [panel.assignment for panel in self.one.state.panels]
        before, assign = int(state.round), self.one._assign  # pyright: ignore[reportPrivateUsage]
        began = time.process_time()
        assign(self.one.progress())  # the step's own call finds nothing left to do
        assigned = time.process_time()
        self.one.step()
        self.steps.append(time.process_time() - assigned)
        if int(state.round) > before:
            self.rounds.append(assigned - began)


def arm(data: Path, steps: int, rounds: int) -> dict[str, object]:
    """Return what a process of its own needs: seconds to the first step, memory, seconds of rounds."""
    torch.set_num_threads(1)
    before, began, cpu = resident(), time.monotonic(), time.process_time()
    with tempfile.TemporaryDirectory() as folder, Recorder(Path(folder), quiet=True) as recorder:
        one = Watched(trainer(data, Path(folder), recorder, steps))
        one.step()
        first = {"seconds": time.monotonic() - began, "cpu_seconds": time.process_time() - cpu}
        at_first = resident()
        while len(one.rounds) < rounds:
            one.step()
        one.one.save()
        checkpoint = sum(file.stat().st_size for file in Path(folder).glob("checkpoints/*"))
        return {
            "first_step": first,
            "memory": {"before": before, "first_step": at_first, "end": resident()},
            "steps": len(one.steps),
            "rounds": one.rounds,
            "checkpoint": checkpoint,
        }


def speeds(many: Path, few: Path, steps: int) -> dict[str, float]:
    """Return CPU seconds of a step of both, in turns; and of a batch alone, read and framed."""
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder, Recorder(Path(folder), quiet=True) as recorder:
        arms = {name: Watched(trainer(path, Path(folder), recorder, steps)) for name, path in
                (("many", many), ("few", few))}  # fmt: skip
        for one in arms.values():
            one.step()
            one.steps.clear()
        ratios = []
        for _ in range(TURNS):
            for one in arms.values():
                for _ in range(EACH):
                    one.step()
            a, b = (statistics.median(arms[name].steps[-EACH:]) for name in ("many", "few"))
            ratios.append(b / a)
        found = {f"step_{name}": statistics.median(one.steps) for name, one in arms.items()}
        return {**found, "steps_a_second_of_few": statistics.median(ratios), "ratios": ratios}  # type: ignore[dict-item]


def in_process(*words: str) -> dict[str, object]:
    """Run a part of this file in a process of its own."""
    command = [sys.executable, __file__, *words]
    return json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def packed(array: Path, folder: Path) -> dict[str, object]:
    """Write masks as PNG files and pack them by the command: seconds of both."""
    from PIL import Image

    pictures, found = folder / "masks", np.load(array, mmap_mode="r")
    pictures.mkdir(exist_ok=True)
    began = time.monotonic()
    for i, mask in enumerate(found):
        Image.fromarray(mask).save(pictures / f"{i:07d}.png")
    wrote, out = time.monotonic(), folder / "pack.npz"
    command = [sys.executable, "-m", "unproject", "data", "pack", str(pictures), "--out", str(out)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()[-1]
    return {
        "files": len(found),
        "seconds_to_write": wrote - began,
        "seconds_to_pack": time.monotonic() - wrote,
        "bytes": out.stat().st_size,
        "said": said.replace(str(folder), ""),
    }


def measured(n: int, few: int, out: Path, steps: int, rounds: int) -> dict[str, object]:
    began = time.monotonic()
    many, small = write_array(out / f"masks-{n}.npy", n), write_array(out / f"masks-{few}.npy", few)
    wrote = time.monotonic() - began
    flags = ["--steps", str(steps), "--rounds", str(rounds)]
    arms = {count: in_process("--arm", str(path), *flags) for count, path in ((n, many), (few, small))}
    memory = {count: found["memory"]["end"] for count, found in arms.items()}  # type: ignore[index]
    more = {name: memory[n][name] - memory[few][name] for name in ("anonymous", "of_files", "all", "largest")}
    whole = many.stat().st_size / 2**20
    return {
        "masks": n,
        "seconds_to_write": wrote,
        "MiB_of_masks": whole,
        "arms": arms,
        "more_MiB_than_few": more,
        "share_of_masks": {name: value / whole for name, value in more.items()},
        "speed": in_process("--speeds", str(many), str(small), *flags),
    }


def run(n: int = 20_000) -> dict[str, object]:
    """Return the figures of fewer masks, for `make bench`."""
    with tempfile.TemporaryDirectory() as folder:
        return measured(n, FEW, Path(folder), 4000, 1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=MILLION, help="masks")
    parser.add_argument("--few", type=int, default=FEW, help="masks that they are compared with")
    parser.add_argument("--out", type=Path, default=Path("million"), help="folder of the arrays, which are kept")
    parser.add_argument("--steps", type=int, default=4000, help="the budget that rounds are spread over")
    parser.add_argument("--rounds", type=int, default=2, help="rounds that are timed")
    parser.add_argument("--folder", action="store_true", help="write PNG files too, and pack them")
    parser.add_argument("--arm", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--speeds", type=Path, nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.arm is not None:
        print(json.dumps(arm(given.arm, given.steps, given.rounds)))
    elif given.speeds is not None:
        print(json.dumps(speeds(*given.speeds, given.steps)))
    else:
        given.out.mkdir(parents=True, exist_ok=True)
        found = measured(given.n, given.few, given.out, given.steps, given.rounds)
        if given.folder:
            found["pack"] = packed(given.out / f"masks-{given.n}.npy", given.out)
        print(json.dumps({**origin(), **found}, indent=1))


if __name__ == "__main__":
    main()
