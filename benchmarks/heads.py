"""A training step of the modern recipe with 64 heads against one with 4: seconds of both, in one run, alternating."""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from pathlib import Path

from unproject.recipes.shapes import shapes
from unproject.training.distribution import Distribution
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer

FEW, MANY, REPEATS = 4, 64, 16


def run() -> dict[str, float]:
    with tempfile.TemporaryDirectory() as folder, Recorder(Path(folder), quiet=True) as recorder:
        trainers = {heads: trainer(heads, Path(folder), recorder) for heads in (FEW, MANY)}
        seconds: dict[int, list[float]] = {FEW: [], MANY: []}
        for _ in range(REPEATS):
            for heads, one in trainers.items():
                start = time.process_time()
                one.step()
                seconds[heads].append(time.process_time() - start)
    few, many = (statistics.median(seconds[heads][1:]) for heads in (FEW, MANY))
    return {"seconds_4_heads": few, "seconds_64_heads": many, "ratio": many / few}


def trainer(heads: int, folder: Path, recorder: Recorder) -> Trainer:
    recipe = shapes(views="known", size=32, bins=heads, views_per_shape=4, steps=10_000)
    return Trainer(recipe, folder, recorder, distribution=Distribution("cpu"))


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
