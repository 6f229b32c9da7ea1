"""Whether the verdict is right: twenty short runs, ten of them made to fail, each with its verdict and the truth.

    python benchmarks/verdicts.py --runs runs/verdicts

Chairs, cars and birds of 16³ voxels (procedural), each learned from 8 silhouettes of 60 shapes in 8 bins of azimuth.
Runs that are there already are not trained again. What the verdict should be follows from the truth, which it does not
see: MMD(1 - IoU) of 64 samples to 60 held-out shapes, up to gauge, over that of 60 training shapes; below 1.4 is good.
So a run that nobody spoiled may fail, and does if it is short: at 250 steps chairs have 1.7.

The levels of the findings come from other runs, of ModelNet classes at 32³.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import torch
from results import finished
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.data import birds, cars, chairs, observe
from unproject.metrics import apply, best_gauge, minimum_matching_distance, one_minus_iou
from unproject.networks import Discriminator
from unproject.projections.silhouette import Silhouette, azimuth_bins
from unproject.recipes.shapes import shapes
from unproject.training import Recipe, Run, load, train

SIZE, BINS, SHAPES, EACH, STEPS, GOOD = 16, 8, 60, 8, 600, 1.4
CLASSES = {"chairs": chairs, "cars": cars, "birds": birds}
Pictures = dict[str, Tensor]


def kept(pictures: Pictures) -> Pictures:
    return pictures


def noise(pictures: Pictures) -> Pictures:
    random = torch.rand(pictures["sil"].shape, generator=generator_at(0, 0, "noise"))
    return pictures | {"sil": (random > 0.5).float()}


def rows_shuffled(pictures: Pictures) -> Pictures:
    """The rows of each picture in an order of its own."""
    sil, rng = pictures["sil"], generator_at(0, 0, "rows")
    return pictures | {"sil": torch.stack([y[:, torch.randperm(y.shape[1], generator=rng)] for y in sil])}


def views_shuffled(pictures: Pictures) -> Pictures:
    order = torch.randperm(len(pictures["azimuth"]), generator=generator_at(0, 0, "views"))
    return pictures | {"azimuth": pictures["azimuth"][order]}


def from_one_side(pictures: Pictures) -> Pictures:
    """Only pictures from within 30° of the front and of the back: none from the sides."""
    inside = (2 * pictures["azimuth"]).cos() > 0.5
    return {name: values[inside] for name, values in pictures.items()}


@dataclass(frozen=True)
class Case:
    """One run: what it learns, whether that is as it should be, and what was done to its pictures and flags."""

    name: str
    classes: tuple[str, ...]
    intact: bool
    change: Callable[[Pictures], Pictures] = kept
    flags: dict[str, Any] = field(default_factory=dict)


KNOWN = {"views": "known"}
CASES = (
    Case("chairs", ("chairs",), True),
    Case("chairs, seed 1", ("chairs",), True, flags={"seed": 1}),
    Case("chairs, known views", ("chairs",), True, flags=KNOWN),
    Case("chairs, known views, seed 1", ("chairs",), True, flags=KNOWN | {"seed": 1}),
    Case("cars", ("cars",), True),
    Case("cars, init-views", ("cars",), True, flags={"init_views": True}),
    Case("cars, known views", ("cars",), True, flags=KNOWN),
    Case("birds", ("birds",), True),
    Case("birds, seed 1", ("birds",), True, flags={"seed": 1}),
    Case("birds, known views", ("birds",), True, flags=KNOWN),
    Case("noise", ("chairs",), False, noise),
    Case("rows shuffled", ("chairs",), False, rows_shuffled),
    Case("mixed classes", ("chairs", "cars", "birds"), False),
    Case("chairs, 10 steps", ("chairs",), False, flags={"steps": 10}),
    Case("chairs, rate 0.1", ("chairs",), False, flags={"rate": 0.1}),
    Case("cars, balance 0, no mirror", ("cars",), False, flags={"balance": 0.0, "mirror": False}),
    Case("birds, balance 0, no mirror", ("birds",), False, flags={"balance": 0.0, "mirror": False}),
    Case("chairs, known views shuffled", ("chairs",), False, views_shuffled, KNOWN),
    Case("cars, known views shuffled", ("cars",), False, views_shuffled, KNOWN),
    Case("chairs, known views, no side views", ("chairs",), False, from_one_side, KNOWN),
)


def volumes(case: Case, seed: int) -> Tensor:
    return torch.cat([CLASSES[name](SHAPES // len(case.classes), SIZE, seed=seed) for name in case.classes])


def pictures_of(case: Case, folder: Path) -> Path:
    """Write the silhouettes that a case learns from, after its change."""
    views = azimuth_bins(BINS, Silhouette(size=SIZE, rule="absorption", density=2.0))
    seen = observe(volumes(case, 0), views, EACH, seed=0)
    assert seen.latents is not None
    found = case.change({"sil": seen.items, "azimuth": seen.latents["azimuth"]})
    path = folder / "pictures.npz"
    folder.mkdir(parents=True, exist_ok=True)
    known = {"azimuth": found["azimuth"].numpy()} if case.flags.get("views") == "known" else {}
    np.savez(path, image=(255 * found["sil"]).round().byte().numpy(), **known)
    return path


def recipe_of(case: Case, folder: Path) -> Recipe:
    small = {"size": SIZE, "bins": BINS, "channels": 32, "rank": 16, "rounds": 15, "batch": 16}
    recipe = shapes(data=pictures_of(case, folder), **{**small, "steps": STEPS, **case.flags})
    return recipe.replace(discriminator=partial(Discriminator, channels=16, shared=4, bottleneck=64, common=True))


def trained(case: Case, runs: Path) -> tuple[Run, Recipe]:
    """Return the run of a case, trained if it is not there."""
    folder = runs / case.name.replace(", ", "-").replace(" ", "-")
    recipe = recipe_of(case, folder)
    place = folder / "run"
    if not list(place.glob("checkpoints/*.safetensors")):
        finished(train(recipe, place, device="cpu", quiet=True))
    return load(place, recipe=recipe), recipe


def truth(run: Run, case: Case) -> float:
    """Return the MMD of samples to held-out shapes, up to gauge if views were unknown, over that of training shapes."""
    x, reference = run.sample(64, seed=1), volumes(case, 1)
    if case.flags.get("views") != "known":
        x = apply(x, best_gauge(x, reference, 2 * BINS))
    own = minimum_matching_distance(one_minus_iou(volumes(case, 0), reference))
    return minimum_matching_distance(one_minus_iou(x, reference)) / own


def row(case: Case, runs: Path) -> dict[str, Any]:
    """Train, judge, and say what the verdict should have been."""
    about = {"name": case.name, "intact": case.intact}
    try:
        run, recipe = trained(case, runs)
    except UserError as error:  # training that diverges twice says so itself
        return about | {"word": "failed", "line": str(error), "truth": math.inf}
    began = time.monotonic()
    verdict = run.verdict()
    seconds = time.monotonic() - began
    values = {finding.name: round(finding.score.value, 3) for finding in verdict.findings}
    found = {"word": verdict.word, "line": verdict.line, "truth": truth(run, case)}
    return about | found | {"seconds": seconds, "values": values}


def is_right(found: dict[str, Any]) -> bool:
    return (found["truth"] < GOOD) == (found["word"] == "good")


def table(rows: Sequence[dict[str, Any]]) -> str:
    lines = ["| run | spoiled | truth | should be | verdict | right | line |", "|" + "---|" * 7]
    for found in rows:
        cells = (
            found["name"],
            "no" if found["intact"] else "yes",
            f"{found['truth']:.2f}",
            "good" if found["truth"] < GOOD else "not good",
            found["word"],
            "yes" if is_right(found) else "NO",
            found["line"],
        )
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join([*lines, f"\n{sum(map(is_right, rows))} of {len(rows)} right"])


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=Path, default=Path("runs/verdicts"))
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args(argv)
    torch.set_num_threads(options.threads)
    rows = []
    for case in CASES:
        rows.append(row(case, options.runs))
        print(rows[-1], flush=True)
    print(table(rows))


if __name__ == "__main__":
    main()
