"""ModelNet chairs at 32³ from silhouettes: Known, Predicted, the PrGAN setting and direct training, side by side.

    python benchmarks/chairs.py --data ARCHIVE.npz --minutes 12 --seeds 2 --parallel 2 --threads 1

Every arm is `unproject train shapes` with one flag changed and the same wall clock. Each is scored against the 100
test chairs with as many samples as there are training chairs, and so is the training set itself. The gauge of the
arms that do not know the views is chosen on the training chairs, never on the test chairs. Arms that are finished
are not computed again: docs/results/chairs/ARM-SEED.json.

Some test chairs are copies of training chairs, which the training set matches at once and no generator should. Scores
that end in `_unseen` leave them out.

`--uneven 45` makes the collection one of photographs, mostly taken from the front: azimuths are normal around 0 with
that deviation in degrees. Results go to docs/results/chairs-uneven, without the direct arm, which has no views.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch
from results import write

from unproject import export
from unproject.data import observe, read
from unproject.metrics import (
    Score,
    ViewAccuracy,
    confusion_picture,
    one_minus_iou,
    shape_scores,
    view_scores,
)
from unproject.projections.observation import Observation
from unproject.projections.priors import TURN, Empirical, Product, Uniform
from unproject.projections.silhouette import Silhouette
from unproject.reproduce.result import provenance
from unproject.training import Run, load
from unproject.training.evaluation import accuracy_of, supervised_ceiling, true_views

ARMS = ("known", "predicted", "single", "direct")
RESULTS = Path(__file__).parent.parent / "docs" / "results"
COPY = 0.1  # 1 - IoU below which a test chair counts as a copy of a training chair
UNEVEN_BALANCE = 0.5  # a collection seen mostly from one side needs less than the recipe's 0.8; as for the birds


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", required=True, help="packed archive of voxels with a class chair")
    parser.add_argument("--minutes", type=float, default=12)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--parallel", type=int, default=1, help="runs at a time")
    parser.add_argument("--threads", type=int, default=2, help="threads a run")
    parser.add_argument("--runs", type=Path, help="folder of the runs: runs/chairs, or runs/chairs-uneven")
    parser.add_argument("--arms", nargs="*", default=list(ARMS))
    parser.add_argument("--uneven", type=float, metavar="DEGREES", help="deviation of the azimuths from the front")
    options = parser.parse_args(argv)
    name = "chairs" if options.uneven is None else "chairs-uneven"
    options.results, options.runs = RESULTS / name, options.runs or Path("runs") / name
    options.results.mkdir(parents=True, exist_ok=True)
    options.images = None
    if options.uneven is not None:
        options.arms = [arm for arm in options.arms if arm != "direct"]
        options.images = uneven_images(options)
    jobs = [(arm, seed) for seed in range(options.seeds) for arm in options.arms]
    jobs = [job for job in jobs if not result(*job, options).exists()]
    with ThreadPoolExecutor(options.parallel) as pool:
        for _ in pool.map(lambda job: train(job[0], job[1], options), jobs):
            pass
    for arm, seed in jobs:
        score(arm, seed, options)
    if not result("training-set", 0, options).exists():
        score_training_set(options)
    print(table(options))


def result(arm: str, seed: int, options: argparse.Namespace) -> Path:
    return options.results / f"{arm}-{seed}.json"


def uneven_images(options: argparse.Namespace) -> Path:
    """16 level silhouettes of each training chair, seen mostly from the front, as `shapes` would render them."""
    path = options.runs / f"uneven-{options.uneven:g}.npz"
    if not path.exists():
        azimuths = torch.randn(2**16, generator=torch.Generator().manual_seed(0)) * options.uneven / 360 * TURN
        prior = Product(Empirical({"azimuth": azimuths % TURN}), Uniform("elevation", 0, 0))
        observed = Observation("photographer", Silhouette(size=32, rule="absorption", density=2.0), prior)
        found = observe(read(f"{options.data}:chair/train"), [observed], each=16, seed=0)
        assert found.latents is not None
        path.parent.mkdir(parents=True, exist_ok=True)
        np.savez(path, silhouettes=found.items[:, 0].numpy(), azimuth=found.latents["azimuth"].numpy())
    return path


def train(arm: str, seed: int, options: argparse.Namespace) -> None:
    out = options.runs / f"{arm}-{seed}"
    if (out / "recipe.json").exists():
        command = ["resume", str(out)]
    else:
        flags = {
            "data": f"{options.data}:chair",
            "size": 32,
            "views": arm,
            "minutes": options.minutes,
            "seed": seed,
            "out": out,
        }
        if options.images:
            flags |= {"data": options.images, "balance": UNEVEN_BALANCE}
        command = ["train", "shapes", *[part for k, v in flags.items() for part in (f"--{k}", str(v))]]
    subprocess.run(
        [sys.executable, "-m", "unproject", *command, "--quiet", "--threads", str(options.threads)], check=True
    )


def score(arm: str, seed: int, options: argparse.Namespace) -> None:
    run = load(options.runs / f"{arm}-{seed}")
    training, test = read(f"{options.data}:chair/train").floats(), read(f"{options.data}:chair/test").floats()
    generated = run.generator.sample(len(training), seed)
    free = arm in ("predicted", "single")
    how = {"selection": training if free else None, "bins": 16 if free else None, "seed": seed}
    scores = shape_scores(generated, test, **how) | unseen_scores(generated, training, test, **how)
    if arm == "predicted":
        found, ceiling = views(run)
        scores |= view_scores(found, ceiling, seed)
        confusion_picture(found.confusion).save(options.results / f"{arm}-{seed}-confusion.webp")
    export.contact_sheet(generated[:8], options.results / f"{arm}-{seed}.webp", size=96)
    about = {"arm": arm, "seed": seed, "steps": run.step} | provenance(run.path)
    write(result(arm, seed, options), {**about, "scores": {name: asdict(value) for name, value in scores.items()}})


def unseen_scores(generated: torch.Tensor, training: torch.Tensor, test: torch.Tensor, **how: Any) -> dict[str, Score]:
    """MMD and COV against the test chairs that are no copies of training chairs."""
    unseen = test[one_minus_iou(training, test).amin(0) >= COPY]
    found = shape_scores(generated, unseen, points=1, **how)
    return {f"{name}_unseen": found[name] for name in ("mmd_iou", "cov_iou")}


def views(run: Run) -> tuple[ViewAccuracy, ViewAccuracy]:
    """Return the accuracy of the assigned views up to gauge, and that of a predictor trained on the true ones."""
    recipe = run.recipe()
    (state,) = run.assignments()
    true = true_views(state.panel)
    assert true is not None
    found = accuracy_of(run.domain, state.panel, state.views, true)
    return found, supervised_ceiling(run.domain, state.panel, true, recipe.seed)


def score_training_set(options: argparse.Namespace) -> None:
    training, test = read(f"{options.data}:chair/train").floats(), read(f"{options.data}:chair/test").floats()
    scores = shape_scores(training, test, bins=None) | unseen_scores(training, training, test, bins=None)
    values = {name: asdict(value) for name, value in scores.items()}
    write(result("training-set", 0, options), {"arm": "training-set", "scores": values})


def table(options: argparse.Namespace) -> str:
    """All results so far, as Markdown; in brackets, how many times the training set's own score."""
    best = json.loads(result("training-set", 0, options).read_text())["scores"]
    columns = ("mmd_iou", "cov_iou", "mmd_iou_unseen", "mmd_iou_equal", "cov_iou_equal", "1nna_iou", "mmd_chamfer")
    lines = ["| arm | seed | steps | " + " | ".join(columns) + " |", "|---" * (len(columns) + 3) + "|"]
    for file in sorted(options.results.glob("*.json")):
        content = json.loads(file.read_text())
        cells = [f"{content['scores'][c]['value']:.3f} ({ratio(content, best, c):.2f}×)" for c in columns]
        first = [content["arm"], str(content.get("seed", "")), str(content.get("steps", ""))]
        lines.append("| " + " | ".join(first + cells) + " |")
    return "\n".join(lines)


def ratio(content: dict, best: dict, column: str) -> float:
    return content["scores"][column]["value"] / best[column]["value"]


if __name__ == "__main__":
    began = time.monotonic()
    main()
    print(f"{(time.monotonic() - began) / 60:.1f} minutes")
