"""MNIST from line integrals: what is known of the directions, and what images come to, upright and up to their turns.

    python benchmarks/digits.py --data FOLDER_OF_MNIST --out OUT --minutes 20 --seeds 0 1
    python benchmarks/digits.py --data FOLDER_OF_MNIST --out OUT --minutes 20 --seeds 0 --arms predicted anchored

Each arm trains `digits` on one thread for some minutes of CPU time, so that it matters little what runs beside:

    direct     on the images themselves
    known      on lines of known direction
    predicted  on lines of unknown direction
    anchored   the same, beside 50 lines of other images with their angles (--anchors): training images that no arm is
               trained on or scored with
    learned    only the distribution of directions is estimated; single: one discriminator for all lines

10,000 images are scored against the 10,000 test images, upright and up to the turn of each, and so are 10,000 training
images. Where directions are unknown, the gauge is chosen on training images. A line of JSON an arm is written to
OUT/results.jsonl, an arm that is there with the same minutes is left out; OUT/ARM-MINUTES-SEED.png has sixty images,
none chosen, after their gauge.
"""

from __future__ import annotations

import argparse
import gzip
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from any_class import trained
from results import Results, budget_of, count_cpu_seconds
from torch import Tensor

import unproject as up
from unproject.data import Collection
from unproject.data.readers.arrays import read_idx
from unproject.data.sampling import spread_rows
from unproject.metrics import Gauge, apply_to_images, image_scores, turned_scores
from unproject.projections.line_integral import directions
from unproject.training.evaluation import accuracy_of, supervised_ceiling, true_views, turns_of

ARMS = ("direct", "known", "predicted", "anchored", "learned", "single")
SIZE, SCORED, FINER, ANCHORS = 32, 10_000, 2, 50
SHOWN = ("frechet", "recall", "frechet_turned", "precision_turned", "recall_turned")


def set_apart(pictures: Path, out: Path) -> tuple[Path, Path]:
    """Write all but fifty of the training images, and lines of these fifty with their angles; return both files."""
    rest, anchors = out / f"training-{pictures.name}", out / "training-anchors.npz"
    if not anchors.exists():
        images = read_idx(pictures)
        rows = spread_rows(len(images), ANCHORS)
        kept = np.delete(images, rows.numpy(), axis=0)
        head = bytes([0, 0, 8, 3]) + np.array(kept.shape, ">u4").tobytes()
        rest.write_bytes(gzip.compress(head + kept.tobytes(), 1))
        some = Collection(Collection.images(pictures, SIZE).batch(rows))
        seen = up.data.observe(some, directions(10, math.radians(2.5)), seed=11)
        np.savez(anchors, lines=seen.items[:, 0].numpy(), angle=(seen.latents or {})["angle"].numpy())
    return rest, anchors


def run_arm(arm: str, seed: int, options: argparse.Namespace, training: Tensor, test: Tensor) -> dict[str, Any]:
    """Train and score one arm."""
    data, apart = set_apart(options.data / TRAINING, options.out)
    flags: dict[str, Any] = {"data": data, "minutes": options.minutes}
    anchors = {"anchors": apart} if arm == "anchored" else {}
    called = f"{arm}-{options.minutes:g}-{seed}"
    views = "predicted" if arm == "anchored" else arm
    recipe = up.recipes.find("digits")(views=views, seed=seed, **flags, **anchors)
    run, found = trained(recipe, options.out / "runs" / called)
    states = run.assignments()
    turns = turns_of(run.domain, states) if arm not in ("direct", "anchored") else None
    images, scores = scored(run.sample(SCORED, seed), training, test, turns and turns * FINER, seed)
    up.export.silhouette_sheet(images[:60], columns=10, scale=2).save(options.out / f"{called}.png")
    true = true_views(states[0].panel) if views == "predicted" else None
    if true is not None:
        panel = states[0].panel
        found_views = accuracy_of(run.domain, panel, states[0].views, true)
        best = ceiling(run, recipe, options.out, true)
        exact, mirrored = found_views.exact, found_views.exact_mirrored or 0.0
        scores |= {"views": exact, "views_of_ceiling": exact / best["exact"]}
        scores |= {"views_mirrored": mirrored, "views_mirrored_of_ceiling": mirrored / best["mirrored"]}
    return found | scores


def scored(
    images: Tensor, training: Tensor, test: Tensor, bins: int | None, seed: int
) -> tuple[Tensor, dict[str, float]]:
    """Return images after their gauge, and all scores."""
    scores = image_scores(images, test, selection=training, bins=bins, seed=seed)
    if bins:
        images = apply_to_images(
            images, Gauge(int(scores["gauge_turn"].value), bool(scores["gauge_reflected"].value), bins)
        )
    scores |= turned_scores(images, test, seed=seed)
    return images, {name: score.value for name, score in scores.items()}


def ceiling(run: up.Run, recipe: up.Recipe, out: Path, true: Tensor) -> dict[str, float]:
    """Return the accuracies of a predictor that is trained on the true directions; computed once."""
    kept = out / "ceiling.json"
    if not kept.exists():
        best = supervised_ceiling(run.domain, recipe.panels[0], true, 0)
        kept.write_text(json.dumps({"exact": best.exact, "mirrored": best.exact_mirrored}))
    return json.loads(kept.read_text())


def table(results: Sequence[dict[str, Any]]) -> str:
    """Return the results as a Markdown table; in brackets, how many times the direct arm's, of one seed and budget."""
    direct = {(r["seed"], r.get("budget")): r for r in results if r["arm"] == "direct"}
    lines = [
        "| arm | seed | minutes | steps | "
        + " | ".join(SHOWN)
        + " | views, of the ceiling, also up to mirror images |",
        "|---" * (len(SHOWN) + 5) + "|",
    ]
    for r in sorted(results, key=lambda r: ((*ARMS, "training set").index(r["arm"]), r["seed"], budget_of(r))):
        base = direct.get((r["seed"], r.get("budget")))
        cells = [f"{r[name]:.3g}" + (f" ({r[name] / base[name]:.2f}×)" if base else "") for name in SHOWN]
        views = ", ".join(f"{r[name]:.2f}" for name in ("views_of_ceiling", "views_mirrored_of_ceiling") if name in r)
        budget = f"{budget_of(r):g} | {r['steps']}" if "steps" in r else " | "  # the training set was not trained
        about = f"| {r['arm']} | {r['seed']} | {budget}"
        lines.append(f"{about} | {' | '.join(cells)} | {views} |")
    return "\n".join(lines)


TRAINING, TEST = (f"{part}-images-idx3-ubyte.gz" for part in ("train", "t10k"))


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with the idx files of MNIST")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seeds", nargs="+", type=int, default=(0, 1))
    parser.add_argument("--arms", nargs="+", choices=ARMS, default=ARMS[:4])
    options = parser.parse_args(argv)
    torch.set_num_threads(1)
    count_cpu_seconds()
    results = Results(options.out / "results.jsonl", ("arm", "seed", "budget"))
    files = set_apart(options.data / TRAINING, options.out)[0], options.data / TEST
    training, test = (Collection.images(file, SIZE).floats() for file in files)
    for seed in options.seeds:
        for arm in options.arms:
            if not results.has(arm, seed, options.minutes):
                about = {"arm": arm, "seed": seed, "budget": options.minutes}
                results.add({**about, **run_arm(arm, seed, options, training, test)})
    if not results.has("training set", 0, None):
        results.add({"arm": "training set", "seed": 0, **scored(training[:SCORED], training, test, None, 0)[1]})
    print(table(results.rows))


if __name__ == "__main__":
    main()
