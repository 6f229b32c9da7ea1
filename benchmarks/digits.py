"""MNIST from line integrals: Known, Predicted, a learned prior, one discriminator and direct training, side by side.

    python benchmarks/digits.py --data FOLDER_OF_MNIST --minutes 20 --seeds 2 --parallel 2 --threads 1

Every arm is `unproject train digits` with one flag changed and the same wall clock. Each is scored with 10000 images
against the 10000 test images, on the features of the digit classifier, and so are 10000 training images. The gauge of
the arms that do not know the directions is chosen on training images. Arms that are finished are not computed again:
docs/results/digits/ARM-SEED.json. figure.webp there is the seed's Fig. 12: data, Known, Predicted.
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

from PIL import Image, ImageDraw, ImageFont
from results import write
from torch import Tensor

from unproject.data import Collection
from unproject.metrics import Gauge, Score, apply_to_images, confusion_picture, image_scores, view_scores
from unproject.reproduce.result import provenance
from unproject.training import load
from unproject.training.evaluation import accuracy_of, supervised_ceiling, true_views, turns_of

ARMS = ("known", "predicted", "direct")
RESULTS = Path(__file__).parent.parent / "docs" / "results" / "digits"
SIZE, SCORED, FINER = 32, 10_000, 2


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with the four idx files of MNIST")
    parser.add_argument("--minutes", type=float, default=20)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--parallel", type=int, default=1, help="runs at a time")
    parser.add_argument("--threads", type=int, default=2, help="threads a run")
    parser.add_argument("--runs", type=Path, default=Path("runs/digits"))
    parser.add_argument("--arms", nargs="*", default=list(ARMS), help="also: learned, single")
    options = parser.parse_args(argv)
    RESULTS.mkdir(parents=True, exist_ok=True)
    jobs = [(arm, seed) for seed in range(options.seeds) for arm in options.arms]
    jobs = [job for job in jobs if not result(*job).exists()]
    with ThreadPoolExecutor(options.parallel) as pool:
        for _ in pool.map(lambda job: train(*job, options), jobs):
            pass
    training, test = (Collection.images(options.data / f"{part}-images-idx3-ubyte.gz", SIZE).floats() for part in PARTS)
    for arm, seed in jobs:
        score(arm, seed, options, training, test)
    if not result("training-set", 0).exists():
        values = image_scores(training[:SCORED], test)
        write(result("training-set", 0), {"arm": "training-set", "scores": as_dict(values)})
    figure(test, options)
    print(table())


PARTS = ("train", "t10k")


def result(arm: str, seed: int) -> Path:
    return RESULTS / f"{arm}-{seed}.json"


def train(arm: str, seed: int, options: argparse.Namespace) -> None:
    out = options.runs / f"{arm}-{seed}"
    if (out / "recipe.json").exists():
        command = ["resume", str(out)]
    else:
        data = options.data / "train-images-idx3-ubyte.gz"
        flags = {"data": data, "views": arm, "minutes": options.minutes, "seed": seed, "out": out}
        command = ["train", "digits", *[part for k, v in flags.items() for part in (f"--{k}", str(v))]]
    subprocess.run(
        [sys.executable, "-m", "unproject", *command, "--quiet", "--threads", str(options.threads)], check=True
    )


def score(arm: str, seed: int, options: argparse.Namespace, training: Tensor, test: Tensor) -> None:
    run = load(options.runs / f"{arm}-{seed}")
    recipe = run.recipe()
    (state,) = run.assignments(recipe)
    turns = turns_of(run.domain, [state])
    generated = run.generator.sample(SCORED, seed)
    scores = image_scores(generated, test, selection=training, bins=turns and turns * FINER, seed=seed)
    true = true_views(state.panel)
    if arm == "predicted" and true is not None:
        found = accuracy_of(run.domain, state.panel, state.views, true)
        scores |= view_scores(found, supervised_ceiling(run.domain, state.panel, true, recipe.seed), seed)
        confusion_picture(found.confusion).save(RESULTS / f"{arm}-{seed}-confusion.webp")
    about = {"arm": arm, "seed": seed, "steps": run.step} | provenance(run.path)
    write(result(arm, seed), {**about, "scores": as_dict(scores)})


def as_dict(scores: dict[str, Score]) -> dict[str, Any]:
    return {name: asdict(value) for name, value in scores.items()}


def figure(test: Tensor, options: argparse.Namespace) -> None:
    """Data, Known and Predicted, the last after its gauge: 60 of each, none chosen."""
    columns = {"data": test[:60]}
    for arm in ("known", "predicted", "direct"):
        if result(arm, 0).exists() and (options.runs / f"{arm}-0" / "recipe.json").exists():
            columns[arm] = apply_to_images(load(options.runs / f"{arm}-0").generator.sample(60, 1), gauge_of(arm))
    width, height, top = 6 * SIZE * 2, 10 * SIZE * 2, 24
    sheet = Image.new("L", ((width + 16) * len(columns) - 16, height + top), 255)
    draw = ImageDraw.Draw(sheet)
    for k, (name, images) in enumerate(columns.items()):
        grid = images[:, 0].view(10, 6, SIZE, SIZE).transpose(1, 2).reshape(10 * SIZE, 6 * SIZE)
        picture = Image.fromarray((grid * 255).byte().numpy()).resize((width, height))
        sheet.paste(picture, (k * (width + 16), top))
        draw.text((k * (width + 16), 2), name, 0, ImageFont.load_default(16))
    sheet.save(RESULTS / "figure.webp")


def gauge_of(arm: str) -> Gauge:
    """What was applied to the generated images of seed 0 when they were scored."""
    scores = json.loads(result(arm, 0).read_text())["scores"]
    if "gauge_turn" not in scores:
        return Gauge()
    bins = int(scores["gauge_turn"]["protocol"].partition("in 1/")[2].split()[0])
    return Gauge(int(scores["gauge_turn"]["value"]), bool(scores["gauge_reflected"]["value"]), bins)


def table() -> str:
    """All results so far, as Markdown; in brackets, how many times the direct arm's of the same seed."""
    columns = ("frechet", "kernel_image", "precision", "recall", "density", "coverage", "class_distance")
    lines = ["| arm | seed | steps | " + " | ".join(columns) + " |", "|---" * (len(columns) + 3) + "|"]
    for file in sorted(RESULTS.glob("*.json")):
        content = json.loads(file.read_text())
        base = result("direct", content.get("seed", 0))
        beside = json.loads(base.read_text())["scores"] if base.exists() else None
        cells = []
        for column in columns:
            value = content["scores"][column]["value"]
            cells.append(f"{value:.3g}" + (f" ({value / beside[column]['value']:.2f}×)" if beside else ""))
        first = [content["arm"], str(content.get("seed", "")), str(content.get("steps", ""))]
        lines.append("| " + " | ".join(first + cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    began = time.monotonic()
    main()
    print(f"{(time.monotonic() - began) / 60:.1f} minutes")
