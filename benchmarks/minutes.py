"""Quality against minutes: what `shapes` comes to in 5, 10, 20, 40 and 80 minutes, of a synthetic and of a real class.

    python benchmarks/minutes.py --data SHARED --out RESULTS                                 # 20 runs, 10.5 hours
    python benchmarks/minutes.py --data SHARED --out RESULTS --classes birds --minutes 5 10

Every budget is a run of its own, from the start: rates, rounds, tries and the fall of weights follow the budget.
Default flags, one seed after another; minutes are CPU minutes of one thread, so that it matters little what runs
beside. SHARED holds shapes3d/ and silhouettes/. An arm is a class, views, a budget and a seed:

    chairs   ModelNet's, 16 binary silhouettes of each of 200, as they are (the form "plain" of any_class.py)
             predicted   nothing is known of the views
             known       the azimuths are given
             direct      no silhouettes: the volumes themselves, 32³
             quality: MMD (1 - IoU, all at one size, the gauge chosen on training shapes) to 100 held-out shapes, over
             that of as many training shapes as samples
    birds    masks of 297 photographs, cropped, as PNGs; every fourth is held out, and shown to no run
             predicted   there is no truth, so no other views, and no 3-D score
             quality: the distance of the held-out masks to silhouettes of samples, over that to as many training
             masks (masks.py)

A line of JSON an arm is written to RESULTS/results.jsonl with its further scores, an arm that is there is left out,
one that was interrupted goes on. At the end there are RESULTS/minutes.md, the table of quality (less is better, 1 is as
near as training data), and RESULTS/minutes.png, its curves, means of seeds, budgets on a logarithmic scale.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from statistics import mean
from typing import Any

import any_class
import masks
import numpy as np
import torch
from PIL import Image, ImageDraw, ImageFont
from results import Results, count_cpu_seconds

import unproject as up

BUDGETS = (5.0, 10.0, 20.0, 40.0, 80.0)
VIEWS = {"chairs": ("predicted", "known", "direct"), "birds": ("predicted",)}
QUALITY = {"chairs": "mmd_ratio", "birds": "distance_ratio"}
HELD_OUT = 4
WIDTH, HEIGHT, MARGIN = 420, 300, 48
INKS = {"predicted": (200, 70, 40), "known": (40, 100, 180), "direct": (110, 110, 110)}


def chairs_arm(views: str, seed: int, minutes: float, data: Path, out: Path) -> dict[str, Any]:
    """Train and score one arm of the synthetic class."""
    folder = any_class.prepare("chair", data, out)
    paths = {"predicted": "plain.npz", "known": "known.npz", "direct": "volumes.npz"}
    if not (folder / "volumes.npz").exists():
        np.savez_compressed(folder / "volumes.npz", volume=torch.load(folder / "truth.pt")["train"].numpy())
    recipe = up.recipes.find("shapes")(data=folder / paths[views], views=views, seed=seed, minutes=minutes)
    run, found = any_class.trained(recipe, out / "runs" / f"chairs-{views}-{minutes:g}-{seed}")
    found |= any_class.shapes_quality(run, folder, fixed=views != "predicted")
    return found | (any_class.views_quality(run, recipe, folder, "plain") if views == "predicted" else {})


def birds_arm(views: str, seed: int, minutes: float, data: Path, out: Path) -> dict[str, Any]:
    """Train and score one arm of the real class."""
    every = masks.SOURCES["birds"].masks(data)
    apart = np.arange(len(every)) % HELD_OUT == HELD_OUT - 1
    shown = masks.write_folder(every[~apart], out / "data" / "birds")
    hidden = masks.write_folder(every[apart], out / "data" / "birds-held-out")
    recipe = up.recipes.find("shapes")(data=shown, views=views, seed=seed, minutes=minutes)
    run, found = any_class.trained(recipe, out / "runs" / f"birds-{views}-{minutes:g}-{seed}")
    panel = recipe.panels[0]
    real = panel.projection.prepare(up.data.read(hidden, size=2 * panel.shape[-1]).floats())
    return found | masks.silhouettes_quality(run, recipe, real)


ARMS = {"chairs": chairs_arm, "birds": birds_arm}


def qualities(rows: Sequence[dict[str, Any]]) -> dict[str, dict[str, dict[float, float]]]:
    """Return class → views → budget → quality, the mean of the seeds."""
    return {
        name: {view: found for view in views if (found := by_budget(rows, name, view))} for name, views in VIEWS.items()
    }


def by_budget(rows: Sequence[dict[str, Any]], name: str, views: str) -> dict[float, float]:
    own = [row for row in rows if (row["class"], row["views"]) == (name, views)]
    budgets = sorted({row["budget"] for row in own})
    return {budget: mean(row[QUALITY[name]] for row in own if row["budget"] == budget) for budget in budgets}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the qualities as a Markdown table, with the steps of each run."""
    budgets = sorted({row["budget"] for row in rows})
    lines = ["| class | views | seed | " + " | ".join(f"{b:g} minutes (steps)" for b in budgets) + " |"]
    lines.append("|---" * (3 + len(budgets)) + "|")
    for name, view, seed in sorted({(row["class"], row["views"], row["seed"]) for row in rows}):
        own = {r["budget"]: r for r in rows if (r["class"], r["views"], r["seed"]) == (name, view, seed)}
        cells = [f"{own[b][QUALITY[name]]:.2f} ({own[b]['steps']})" if b in own else "" for b in budgets]
        lines.append(f"| {name} | {view} | {seed} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def curves(found: dict[str, dict[str, dict[float, float]]]) -> Image.Image:
    """Return a graph a class, side by side: quality over the logarithm of the budget, a line for each of the views."""
    shown = {name: views for name, views in found.items() if views}
    sheet = Image.new("RGB", (WIDTH * max(len(shown), 1), HEIGHT), "white")
    for k, (name, views) in enumerate(shown.items()):
        sheet.paste(graph(f"{name}: {QUALITY[name].replace('_', ' ')}", views), (k * WIDTH, 0))
    return sheet


def graph(title: str, lines: dict[str, dict[float, float]]) -> Image.Image:
    """Return lines, name → budget → value, over the logarithm of the budget; values from 1, or below, upwards."""
    picture = Image.new("RGB", (WIDTH, HEIGHT), "white")
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(size=12)
    budgets = sorted({budget for line in lines.values() for budget in line})
    values = [value for line in lines.values() for value in line.values()]
    low, high = min(1.0, *values), max(1.1, *values)
    first, last = math.log(budgets[0]), max(math.log(budgets[-1]), math.log(budgets[0]) + 0.1)

    def place(budget: float, value: float) -> tuple[float, float]:
        across = (math.log(budget) - first) / (last - first)
        above = (value - low) / (high - low)
        return MARGIN + across * (WIDTH - 2 * MARGIN), HEIGHT - MARGIN - above * (HEIGHT - 2 * MARGIN)

    draw.text((WIDTH / 2, 14), title, fill="black", font=font, anchor="mm")
    for value in (low, (low + high) / 2, high):
        draw.line((place(budgets[0], value), place(math.exp(last), value)), fill=(220, 220, 220))
        draw.text((6, place(budgets[0], value)[1]), f"{value:.2f}", fill="black", font=font, anchor="lm")
    for budget in budgets:
        draw.text((place(budget, low)[0], HEIGHT - 28), f"{budget:g} min", fill="black", font=font, anchor="mm")
    for k, (name, line) in enumerate(lines.items()):
        points = [place(*point) for point in line.items()]
        draw.line(points, fill=INKS[name], width=2)
        for x, y in points:
            draw.ellipse((x - 3, y - 3, x + 3, y + 3), fill=INKS[name])
        draw.text((MARGIN + 100 * k, HEIGHT - 10), name, fill=INKS[name], font=font, anchor="lm")
    return picture


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="the folder that holds shapes3d/ and silhouettes/")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", nargs="+", type=float, default=BUDGETS)
    parser.add_argument("--classes", nargs="+", choices=ARMS, default=tuple(ARMS))
    parser.add_argument("--views", nargs="+", choices=INKS, default=tuple(INKS))
    parser.add_argument("--seeds", nargs="+", type=int, default=(0,))
    given = parser.parse_args(argv)
    torch.set_num_threads(1)
    count_cpu_seconds()
    results = Results(given.out / "results.jsonl", ("class", "views", "budget", "seed"))
    arms = [(name, v, b, s) for s in given.seeds for b in given.minutes for name in given.classes for v in VIEWS[name]]
    for name, views, budget, seed in arms:
        if views in given.views and not results.has(name, views, budget, seed):
            found = ARMS[name](views, seed, budget, given.data, given.out)
            about = {"class": name, "views": views, "budget": budget, "seed": seed}
            results.add({**found, **about})
    if results.rows:
        (given.out / "minutes.md").write_text(table(results.rows) + "\n", encoding="utf-8")
        curves(qualities(results.rows)).save(given.out / "minutes.png")
        print(table(results.rows))


if __name__ == "__main__":
    main()
