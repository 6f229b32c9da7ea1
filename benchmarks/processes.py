"""Two processes against one: samples a second, and what they send each other in a step.

    python benchmarks/processes.py --steps 40              # shapes at 32³, a thread each
    python benchmarks/processes.py --steps 40 --size 64

One process with a batch of b, then two with b each, in turns. Where other programs use the machine, the clock measures
them; so CPU seconds a sample are given as well, which other programs do not change, and hold what a process computes to
communicate, but not what it waits. With c_1 and c_2 the CPU seconds of a process in a step of 1 and of 2 processes, and
w the seconds that a collective operation waits for the network,

    samples a second = 2 b / (c_2 + w)  against  b / c_1

Two processes that know nothing of each other are measured too: where they need more CPU seconds than one alone, the
cores share what they compute with (caches, memory, the units of a core), which no program changes.

Bytes and operations are counted where torch.distributed is called.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import torch
import torch.distributed as dist

from unproject.recipes.shapes import shapes
from unproject.training.distribution import Distribution
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer

WARM = 5
HERE = Path(__file__)


class Counter:
    """What goes through torch.distributed: operations, bytes, and seconds in them by the clock and by the processor."""

    def __init__(self) -> None:
        self.operations, self.bytes, self.seconds, self.cpu = 0, 0, 0.0, 0.0
        for name in ("all_reduce", "broadcast"):
            setattr(dist, name, self.counted(getattr(dist, name)))

    def counted(self, operation: Callable[..., Any]) -> Callable[..., Any]:
        def call(tensor: torch.Tensor, *positional: Any, **named: Any) -> Any:
            began, cpu = time.perf_counter(), time.process_time()
            found = operation(tensor, *positional, **named)
            self.operations += 1
            self.bytes += tensor.numel() * tensor.element_size()
            self.seconds += time.perf_counter() - began
            self.cpu += time.process_time() - cpu
            return found

        return call

    def read(self) -> list[float]:
        return [self.operations, self.bytes, self.seconds, self.cpu]


def steps(count: int, size: int, channels: int, batch: int, over: Literal["processes"] | None) -> dict[str, float]:
    """Return medians of a step: seconds, CPU seconds, and what is sent; as one of `world` processes."""
    torch.set_num_threads(1)
    counter = Counter()
    recipe = shapes(
        views="known", size=size, channels=channels, views_per_shape=4, steps=10_000, batch=batch, normalise_over=over
    )
    with tempfile.TemporaryDirectory() as folder, Recorder(Path(folder), quiet=True, leads=False) as recorder:
        one = Trainer(recipe, Path(folder), recorder, distribution=Distribution("cpu"))
        rows = []
        for _ in range(count + WARM):
            before = [time.perf_counter(), time.process_time(), *counter.read()]
            one.step()
            after = [time.perf_counter(), time.process_time(), *counter.read()]
            rows.append([b - a for a, b in zip(before, after, strict=True)])
        one.distribution.close()
    names = ("seconds", "cpu_seconds", "operations", "bytes", "seconds_in_operations", "cpu_seconds_in_operations")
    medians = [statistics.median(column) for column in zip(*rows[WARM:], strict=True)]
    weights = {f"weights_of_{n}": float(sum(p.numel() for p in m.parameters())) for n, m in one.state.modules()}
    return {**dict(zip(names, medians, strict=True)), "batch": batch, **weights}


def in_processes(arm: str, flags: list[str]) -> dict[str, float]:
    """Return what the first process of an arm finds: "one", "two", or "apart", two that know nothing of each other."""
    agent = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"] if arm == "two" else []
    command = [sys.executable, *agent, str(HERE), "--steps-of", *flags]
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    started = [
        subprocess.Popen(command, env=environment, stdout=-1, stderr=-1, text=True) for _ in range(1 + (arm == "apart"))
    ]
    said = [process.communicate()[0] for process in started]
    return json.loads(said[0].splitlines()[-1])


def measured(turns: int, flags: list[str]) -> dict[str, Any]:
    """Return each arm's medians of turns, and the ratios of samples a second: by the clock, and by CPU seconds."""
    found: dict[str, list[dict[str, float]]] = {"one": [], "apart": [], "two": []}
    for _ in range(turns):
        for arm, rows in found.items():
            rows.append(in_processes(arm, flags))
    one, apart, two = ({k: statistics.median(row[k] for row in rows) for k in rows[0]} for rows in found.values())
    return {
        "one": one,
        "two_apart": {name: apart[name] for name in ("seconds", "cpu_seconds")},
        "two": two,
        "samples_a_second_by_cpu_seconds_of_two_apart": 2 * apart["cpu_seconds"] / two["cpu_seconds"],
        "samples_a_second_by_clock": 2 * one["seconds"] / two["seconds"],
        "samples_a_cpu_second_of_each": one["cpu_seconds"] / two["cpu_seconds"],
        "samples_a_second_by_cpu_seconds": 2 * one["cpu_seconds"] / two["cpu_seconds"],
    }


def run() -> dict[str, Any]:
    """Return the figures for `make bench`."""
    return measured(1, ["--steps", "20"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=40)
    parser.add_argument("--size", type=int, default=32, help="voxels a side")
    parser.add_argument("--channels", type=int, default=128)
    parser.add_argument("--batch", type=int, default=48)
    parser.add_argument("--normalise-over", choices=["processes"], help="as the flag of `unproject train`")
    parser.add_argument("--turns", type=int, default=2)
    parser.add_argument("--steps-of", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.steps_of:
        found = steps(given.steps, given.size, given.channels, given.batch, given.normalise_over)
        if os.environ.get("RANK", "0") == "0":
            print(json.dumps(found))
        return
    flags = [f"--{name}={getattr(given, name)}" for name in ("steps", "size", "channels", "batch")]
    flags += ["--normalise-over=processes"] if given.normalise_over else []
    print(json.dumps(measured(given.turns, flags), indent=1))


if __name__ == "__main__":
    main()
