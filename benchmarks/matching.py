"""Materials with and without matched statistics of the second order: how their maps go together, and what else changes.

    python benchmarks/matching.py --out OUT --data metal plastic --weights 0 2 --seeds 0 --steps 800

Each arm trains a recipe of materials on one thread (`--matching`; the weight falls to a quarter) and compares 300
samples with as many materials of the procedural data set that no training has seen. A line of JSON an arm is written to
OUT/results.jsonl, an arm that is there is left out; OUT/DATA-WEIGHT-EVERY-SEED.png shows eight samples, none chosen.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import torch
from results import Results, finished

import unproject as up
from unproject.metrics import material_scores
from unproject.recipes.materials import PROCEDURAL

UNSEEN = 2**40
"""Seed of the materials that samples are compared with."""
KEY = ("data", "weight", "every", "seed", "steps")


def run_arm(data: str, weight: float, every: int, seed: int, options: argparse.Namespace) -> dict[str, Any]:
    """Train, or go on with what is there, and score."""
    name = f"{data}-{weight:g}-{every}-{seed}"
    place = options.out / "runs" / name
    flags = {"size": options.size, "seed": seed, "steps": options.steps, "matching": weight}
    recipe = up.recipes.find(data)(**flags)
    if recipe.matching is not None:
        recipe = recipe.replace(matching=replace(recipe.matching, every=every))
    begun, began = (place / "recipe.json").exists(), time.process_time()
    run = finished(up.resume(place, quiet=True) if begun else up.train(recipe, place, quiet=True))
    seconds = time.process_time() - began
    x, truth = run.sample(options.n, seed=1), PROCEDURAL[data](options.n, options.size, UNSEEN)
    run.domain.write_preview(x[:8], options.out / f"{name}.png")
    return {"cpu_seconds": round(seconds), **{k: score.value for k, score in material_scores(x, truth).items()}}


def table(results: Sequence[dict[str, Any]]) -> str:
    """Return the results as a Markdown table."""
    head = "| data | weight | every | seed | CPU s | patches: D, S, R, N | correlation error "
    head += "| precision | recall | coverage |"
    lines = [head, "|---" * 10 + "|"]
    for r in results:
        patches = " ".join(f"{r[f'patch_{name}']:.3f}" for name in ("diffuse", "specular", "roughness", "normal"))
        shares = " | ".join(f"{r[name]:.2f}" for name in ("precision", "recall", "coverage"))
        lines.append(
            f"| {r['data']} | {r['weight']:g} | {r['every']} | {r['seed']} | {r['cpu_seconds']} | {patches} "
            f"| {r['correlation_error']:.3f} | {shares} |"
        )
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--data", nargs="+", choices=tuple(PROCEDURAL), default=("wood", "correlated"))
    parser.add_argument("--weights", nargs="+", type=float, default=(0.0, 2.0))
    parser.add_argument("--every", nargs="+", type=int, default=(3,), help="updates between two with the loss")
    parser.add_argument("--seeds", nargs="+", type=int, default=(0,))
    parser.add_argument("--steps", type=int, default=800)
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--n", type=int, default=300, help="samples, and materials that they are compared with")
    options = parser.parse_args(argv)
    torch.set_num_threads(1)
    results = Results(options.out / "results.jsonl", KEY)
    for seed, *what in product(options.seeds, options.data, options.weights, options.every):
        arm = (*what, seed)
        if not results.has(*arm, options.steps):
            results.add(dict(zip(KEY, (*arm, options.steps), strict=True)) | run_arm(*arm, options))
    print(table(results.rows))


if __name__ == "__main__":
    main()
