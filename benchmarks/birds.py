"""Real photographs: 3-D birds from cut-out masks of unknown views.

    python benchmarks/birds.py --data MASKS.npz --minutes 20 --out docs/results/birds

Leaves shapes.webp (new shapes from four azimuths) and birds.json (scores of the silhouettes, seconds, machine). No mask
is among them, for its licence's sake: `unproject studio runs/` shows them by the view that they were assigned.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import torch

from unproject import export
from unproject.data import read
from unproject.recipes.shapes import shapes
from unproject.training import load, train


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--size", type=int, default=64)
    parser.add_argument("--balance", type=float, default=0.5, help="most birds were photographed from the side")
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    parser.add_argument("--runs", type=Path, default=Path("runs/birds"))
    parser.add_argument("--out", type=Path, default=Path("docs/results/birds"))
    options = parser.parse_args(argv)
    torch.set_num_threads(options.threads)
    budget = {"minutes": options.minutes, "seed": options.seed}
    # At 64³ a round costs as much as ten steps.
    how = {"flips": True, "balance": options.balance, "rounds": 12, "batch": 24}
    recipe = shapes(data=options.data, size=options.size, **how, **budget)
    if not (options.runs / "recipe.json").exists():
        train(recipe, options.runs, quiet=True)
    run = load(options.runs)
    options.out.mkdir(parents=True, exist_ok=True)
    export.contact_sheet(run.generator.sample(8, options.seed), options.out / "shapes.webp", size=128)
    masks = read(options.data, size=options.size)
    scores = run.evaluate(masks, n=len(masks), seed=options.seed)
    about = {
        "seed": options.seed,
        "steps": run.step,
        "minutes": options.minutes,
        "environment": json.loads((options.runs / "environment.json").read_text()),
    }
    result = {**about, "scores": {name: asdict(score) for name, score in scores.items()}}
    (options.out / "birds.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
