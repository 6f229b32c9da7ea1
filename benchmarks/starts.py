"""Single starts of `shapes` on a class, scored on the way: which settings find the true world, and what tells it.

    python benchmarks/starts.py --data SHARED --out RESULTS --classes bed table --seeds 0 1 --steps 1200 --at 600 1200
    python benchmarks/starts.py --data SHARED --out RESULTS --classes bed --set information=0.0 --views-per-sample 2

Pictures are those of any_class.py, at 32³, one start (no tries), one thread. At each step of `--at` a line of JSON is
written to RESULTS/starts.jsonl: what the run itself can know (the findings of its verdict, the information of views of
pictures and of projections, nats) beside the truth (MMD and COV over the training set's own; accuracy of views over
that of a predictor trained on the true ones). A start that is there is left out.
"""

from __future__ import annotations

import argparse
import ast
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from any_class import BINS, CLASSES, FORMS, SIZE, ceiling, path_of, prepare, true_bins
from results import Results
from torch import Tensor

import unproject as up
from unproject.metrics import shape_scores, view_accuracy
from unproject.ops import unit_sized
from unproject.training.recorder import Recorder
from unproject.training.trainer import Trainer
from unproject.training.verdict import judge

KEY = ("class", "form", "seed", "settings", "steps", "step")


def settings_of(words: Sequence[str]) -> dict[str, Any]:
    """Return the flags of a recipe of NAME=VALUE."""
    return {name: ast.literal_eval(value) for name, _, value in (word.partition("=") for word in words)}


def known_to_the_run(trainer: Trainer) -> dict[str, float]:
    """Return what can be measured without the truth."""
    state = trainer.state
    verdict = judge(state.sampler(), state.domain, [panel.assignment for panel in state.panels])
    return {f.name: f.score.value for f in verdict.findings} | state.panels[0].assignment.log()


def truth_of(trainer: Trainer, folder: Path, form: str) -> dict[str, float]:
    """Return the scores of shapes, and of views."""
    stored = torch.load(folder / "truth.pt")
    train, test = unit_sized(stored["train"]), unit_sized(stored["test"])
    own = shape_scores(train, test, bins=None)
    x = trainer.state.sampler().sample(len(train), seed=1)
    found = shape_scores(unit_sized(x), test, selection=train[:100], bins=BINS)
    ratios = {f"{name}_ratio": found[f"{name}_iou"].value / own[f"{name}_iou"].value for name in ("mmd", "cov")}
    views = accuracy(trainer, stored["azimuth"])
    return ratios | {"accuracy": views, "accuracy_of_ceiling": views / ceiling(folder, form, stored["azimuth"])}


def accuracy(trainer: Trainer, azimuth: Tensor) -> float:
    """Return the share of pictures whose view is right."""
    panel = trainer.state.panels[0]
    assigned = panel.assignment.estimates()
    assert assigned is not None
    rows = torch.tensor([int(Path(name).stem) for name in panel.panel.collections[0].names])
    return view_accuracy(assigned, true_bins(azimuth)[rows], BINS).exact


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="the folder that holds shapes3d/")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--classes", nargs="+", choices=CLASSES, default=("bed", "table"))
    parser.add_argument("--form", choices=FORMS[:2], default="cropped")
    parser.add_argument("--seeds", nargs="+", type=int, default=(0, 1))
    parser.add_argument("--steps", type=int, default=1200, help="the budget")
    parser.add_argument("--at", nargs="+", type=int, default=(600, 1200), help="steps at which to score")
    parser.add_argument("--set", nargs="*", default=(), metavar="NAME=VALUE", help="flags of the recipe")
    parser.add_argument("--views-per-sample", type=int, default=4)
    given = parser.parse_args()
    torch.set_num_threads(1)
    results = Results(given.out / "starts.jsonl", KEY)
    for name in given.classes:
        folder = prepare(name, given.data, given.out)
        for seed in given.seeds:
            run_start(given, name, seed, folder, results)


def run_start(given: argparse.Namespace, name: str, seed: int, folder: Path, results: Results) -> None:
    """Train one start, and score it on the way."""
    settings = " ".join([*given.set, f"views_per_sample={given.views_per_sample}"])
    arm = {"class": name, "form": given.form, "seed": seed, "settings": settings, "steps": given.steps}
    if results.has(*arm.values(), given.at[-1]):
        return
    flags = {"data": path_of(folder, given.form), "size": SIZE, "seed": seed, "steps": given.steps, "tries": 1}
    recipe = up.recipes.find("shapes")(**flags | settings_of(given.set))
    recipe = recipe.replace(views_per_sample=given.views_per_sample)
    with tempfile.TemporaryDirectory() as place, Recorder(Path(place), quiet=True) as recorder:
        trainer = Trainer(recipe, Path(place), recorder)
        for stop in given.at:
            while trainer.state.counters.step < stop:
                trainer.step()
            results.add({**arm, "step": stop, **known_to_the_run(trainer), **truth_of(trainer, folder, given.form)})


if __name__ == "__main__":
    main()
