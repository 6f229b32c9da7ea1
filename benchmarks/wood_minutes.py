"""What time buys for materials: several projections and one discriminator of all maps (Fig. 7), by minutes.

    python benchmarks/wood_minutes.py --out OUT --minutes 9 60 --arms wood-multi wood-joint --seeds 0

The arms are those of `unproject reproduce fig7`, scored as there, against woods that no training has seen; but minutes
are CPU minutes of one thread, so that it matters little what runs beside. Every budget is a run of its own, from the
start: weights fall with the budget. A line of JSON an arm is written to OUT/results.jsonl, an arm that is there is left
out, one that was interrupted goes on; OUT/ARM-MINUTES-SEED.png shows its first samples, none chosen.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from any_class import trained
from results import Results, count_cpu_seconds

import unproject as up
from unproject.export import save_image
from unproject.reproduce.budgets import flags_of
from unproject.reproduce.figures_of_materials import MATERIALS, PATCHES
from unproject.reproduce.place import Place
from unproject.reproduce.scoring import score_materials, scored
from unproject.reproduce.sources import SOURCES

ARMS = {arm.name: arm for arm in MATERIALS[0].arms if not arm.of_paper}


def run_arm(name: str, minutes: float, seed: int, out: Path) -> dict[str, Any]:
    """Train, or go on with what is there, and score."""
    arm = ARMS[name]
    flags = flags_of(arm, "cpu") | {"minutes": minutes, "seed": seed}
    run, found = trained(up.recipes.find(arm.recipe)(**flags), out / "runs" / f"{name}-{minutes:g}-{seed}")
    samples = run.sample(scored(run.domain), seed)
    save_image(run.domain.preview(samples[: run.domain.previewed]), out / f"{name}-{minutes:g}-{seed}.png")
    reference = SOURCES[arm.source].reference(Place(out / "sources", None, flags["size"]))
    scores = score_materials(run.domain, samples, reference, arm.source, seed)
    return found | {name: score.value for name, score in scores.items()}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the results as a Markdown table."""
    head = "| arm | seed | minutes (steps) | patches: D, S, R, N | correlation error | precision | recall | coverage |"
    lines = [head, "|---" * 8 + "|"]
    for row in sorted(rows, key=lambda row: (row["arm"], row["seed"], row["budget"])):
        patches = " ".join(f"{row[name]:.3f}" for name in PATCHES)
        shares = " | ".join(f"{row[name]:.2f}" for name in ("precision", "recall", "coverage"))
        about = f"| {row['arm']} | {row['seed']} | {row['budget']:g} ({row['steps']})"
        lines.append(f"{about} | {patches} | {row['correlation_error']:.3f} | {shares} |")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", nargs="+", type=float, default=(9.0, 60.0))
    parser.add_argument("--arms", nargs="+", choices=tuple(ARMS), default=("wood-multi", "wood-joint"))
    parser.add_argument("--seeds", nargs="+", type=int, default=(0,))
    given = parser.parse_args(argv)
    torch.set_num_threads(1)
    count_cpu_seconds()
    results = Results(given.out / "results.jsonl", ("arm", "budget", "seed"))
    for seed in given.seeds:
        for budget in given.minutes:
            for name in given.arms:
                if not results.has(name, budget, seed):
                    found = run_arm(name, budget, seed, given.out)
                    results.add({**found, "arm": name, "budget": budget, "seed": seed})
    print(table(results.rows))


if __name__ == "__main__":
    main()
