"""How much sooner the modern recipe reaches a given MMD than the seed's, on the same machine, in one run.

Both learn the embedded chairs at 32³ from silhouettes of known views. The modern recipe trains until MMD(1 - IoU)
of 128 samples against 100 held-out chairs reaches the target; the seed's recipe then gets at most `LIMIT` times
that time. Scoring does not count. "at least" stands where the seed's recipe was stopped by its limit.
"""

from __future__ import annotations

import json
import tempfile
import time
from pathlib import Path

from unproject.data import chairs
from unproject.metrics import minimum_matching_distance, one_minus_iou
from unproject.recipes.shapes import shapes, shapes_paper
from unproject.training import Recipe
from unproject.training.distribution import Distribution
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer

TARGET, LIMIT, LONGEST, CHECK = 0.55, 5.5, 300.0, 10.0


def run() -> dict[str, float | str]:
    modern, reached = seconds_to(TARGET, shapes(views="known", size=32, steps=10**6), LONGEST)
    if not reached:
        return {"target": TARGET, "modern_seconds": modern, "ratio": "the modern recipe missed the target"}
    paper, reached = seconds_to(TARGET, shapes_paper(views="known", size=32, channels=256, steps=10**6), LIMIT * modern)
    words = f"{paper / modern:.1f}" if reached else f"at least {paper / modern:.1f}"
    return {"target": TARGET, "modern_seconds": modern, "paper_seconds": paper, "ratio": words}


def seconds_to(target: float, recipe: Recipe, longest: float) -> tuple[float, bool]:
    """(seconds of training, whether the target was reached)."""
    reference = chairs(100, 32, seed=1)
    trained, due = 0.0, CHECK
    with tempfile.TemporaryDirectory() as folder, Recorder(Path(folder), quiet=True) as recorder:
        never = recipe.replace(checkpoint_every=10**9)
        one = Trainer(never, Path(folder), recorder, distribution=Distribution("cpu"))
        while trained < longest:
            start = time.monotonic()
            one.step()
            trained += time.monotonic() - start
            if trained >= due:
                due = trained + CHECK
                generated = one.state.average.sample(128)
                if minimum_matching_distance(one_minus_iou(generated, reference)) <= target:
                    return trained, True
    return trained, False


if __name__ == "__main__":
    print(json.dumps(run(), indent=2))
