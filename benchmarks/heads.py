"""A training step of the modern recipe with 64 heads against one with 4: seconds of both, in one run, alternating."""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from pathlib import Path

from unproject.recipes.shapes import shapes
from unproject.training.distribution import Distribution
from unproject.training.loop import Loop
from unproject.training.recorder import Recorder
from unproject.training.state import State

FEW, MANY, REPEATS = 4, 64, 16


def run() -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder:
        loops = {heads: loop(heads, Path(folder)) for heads in (FEW, MANY)}
        seconds: dict[int, list[float]] = {FEW: [], MANY: []}
        for _ in range(REPEATS):
            for heads, one in loops.items():
                start = time.process_time()
                one.advance()
                seconds[heads].append(time.process_time() - start)
    few, many = (statistics.median(seconds[heads][1:]) for heads in (FEW, MANY))
    return {"seconds_4_heads": few, "seconds_64_heads": many, "ratio": many / few}


def loop(heads: int, folder: Path) -> Loop:
    recipe = shapes(views="known", bins=heads, looks_per_shape=4, steps=10_000)
    made = Loop(recipe, folder, State(recipe, Distribution("cpu").device), Distribution("cpu"))
    made.recorder = Recorder(folder, 0, quiet=True)
    return made


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
