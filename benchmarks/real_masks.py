"""Shapes of real masks with default flags: what somebody gets who has pictures, and gives nothing but --data.

    python benchmarks/real_masks.py --data SHARED --out RESULTS --minutes 20         # six classes, one after another
    python benchmarks/real_masks.py --data SHARED --out RESULTS --classes birds --minutes 5

SHARED holds silhouettes/: 297 birds (masks of CUB-200-2011), 100 chairs and 154 seats (cut from IKEA's photographs), 64
pixels a side, and of the Caltech 101 silhouettes, 28 pixels a side, airplanes (798), motorbikes (798) and cars from the
side (123). These are the three classes of vehicles with most pictures, named before any was trained; of the classes
with more pictures than cars, faces and watches are seen from the front only, and a leopard's or a bonsai's shape is
none to know by its outline. Whoever made these silhouettes stretched each to one of a few boxes, of cars 0.93 or 1.44
as wide as high: outlines of one side look like views of several, and proportions that are learned are not a car's.

Each class is written once as a folder of PNGs and trained by `unproject train shapes --data FOLDER --minutes MINUTES`
(and --out, --threads, which decide nothing of the method) in a process of its own. In RESULTS there are then

    NAME-shapes.png     twelve samples as they are, a row each: level views from 0°, 90°, 180°, 270°, and an oblique one
    NAME-pictures.png   24 of the training pictures
    NAME-views.png      a row a view bin: how many pictures were assigned to it, and six of them
    results.jsonl       a line a class: the verdict, steps, minutes, the share in one piece, and how near silhouettes
                        come to the pictures that the recipe holds out (masks.py)

A class that is there is left out, one that was interrupted goes on, and the table is printed at the end.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch
from masks import SOURCES, silhouettes_quality, some_of, write_folder
from PIL import Image, ImageDraw, ImageFont
from results import Results, minutes_of
from torch import Tensor

from unproject import export
from unproject.assignment import AssignmentState
from unproject.training import Run, load
from unproject.training.run_directory import VERDICT

SAMPLES, PICTURES, EACH = 12, 24, 6
SIDES, OBLIQUE = tuple(math.radians(a) for a in (0, 90, 180, 270)), math.radians(35)
REFUSED = 2
"""Exit status of an error that is told in one line, as that training diverges."""
CELL, LABEL, BAR = 48, 110, 200
"""Pixels of a picture, a label and the longest bar in the picture of views."""


def train(folder: Path, place: Path, minutes: float, threads: int) -> str:
    """Train, or go on with what was interrupted, by the command line; return what it refuses or gives up with, or "".

    Raises:
        SystemExit: if training was stopped or killed: the class is not done.
    """
    if (place / VERDICT).exists():
        return ""
    if (place / "recipe.json").exists():
        words = ["resume", str(place)]
    else:
        words = ["train", "shapes", "--data", str(folder), "--minutes", f"{minutes:g}", "--out", str(place)]
    command = [sys.executable, "-m", "unproject", *words, "--threads", str(threads)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != REFUSED and not (place / VERDICT).exists():
        raise SystemExit(f"{place}: not done\n{done.stderr}")
    return done.stderr.strip().splitlines()[-1] if done.returncode else ""


def shapes_sheet(x: Tensor, size: int = 96) -> Image.Image:
    """Return each shape, a row, from four sides at eye level and from above one corner."""
    level = export.contact_sheet(x, azimuths=SIDES, elevation=0.0, size=size)
    above = export.contact_sheet(x, azimuths=[OBLIQUE], elevation=math.radians(25), size=size)
    sheet = Image.new("RGB", (level.width + above.width, level.height), "white")
    sheet.paste(level)
    sheet.paste(above, (level.width, 0))
    return sheet


def views_sheet(state: AssignmentState) -> Image.Image:
    """Return a row a bin: its azimuth and number of pictures, a bar as long as that, and the first pictures."""
    bins, images = len(state.panel.observations), state.panel.collections[0].floats()
    counts = torch.bincount(state.views, minlength=bins).tolist()
    sheet = Image.new("RGB", (LABEL + BAR + EACH * CELL, bins * CELL), "white")
    draw, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=12)
    for k, count in enumerate(counts):
        top, length = k * CELL, round(BAR * count / max(*counts, 1))
        draw.text((6, top + CELL // 2), f"{360 * k / bins:.0f}°: {count}", fill="black", font=font, anchor="lm")
        draw.rectangle((LABEL - 30, top + 8, LABEL - 30 + length, top + CELL - 8), fill=(90, 130, 180))
        if count:
            some = export.silhouette_sheet(images[state.views == k][:EACH], columns=EACH)
            some = some.resize((CELL * min(count, EACH), CELL))
            sheet.paste(some, (LABEL + BAR, top))
    return sheet


def show(run: Run, state: AssignmentState, out: Path, name: str) -> None:
    """Write the three pictures of a class."""
    shapes_sheet(run.sample(SAMPLES)).save(out / f"{name}-shapes.png")
    pictures = some_of(state.panel.collections[0], PICTURES)
    export.silhouette_sheet(pictures, out / f"{name}-pictures.png", columns=4, scale=3)
    views_sheet(state).save(out / f"{name}-views.png")


def result_of(place: Path, out: Path, name: str) -> dict[str, Any]:
    """Open a run that is done, write its pictures, and return what it came to."""
    run = load(place)
    recipe = run.recipe()
    (state,) = run.assignments()
    show(run, state, out, name)
    verdict = json.loads((place / VERDICT).read_text(encoding="utf-8"))
    held_out = state.panel.held_out
    found = {} if held_out is None else silhouettes_quality(run, recipe, held_out.floats())
    about = {"verdict": verdict["word"], "line": verdict["line"], "steps": run.step}
    views = {name: score.value for name, score in state.checks().items()}
    return about | {"minutes": minutes_of(run), **found, **views}


def table(rows: Sequence[dict[str, Any]]) -> str:
    """Return the results as a Markdown table."""
    names = ("class", "pictures", "steps", "in one piece", "distance / own", "views used", "verdict")
    lines = ["| " + " | ".join(names) + " |", "|---" * len(names) + "|"]
    for row in rows:
        numbers = [f"{row[key]:.2f}" if key in row else "" for key in ("in_one_piece", "distance_ratio", "views_used")]
        cells = [row["class"], str(row["pictures"]), str(row.get("steps", "")), *numbers, row["line"]]
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="the folder that holds silhouettes/")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--classes", nargs="+", choices=SOURCES, default=tuple(SOURCES))
    parser.add_argument("--threads", type=int, default=1)
    given = parser.parse_args(argv)
    torch.set_num_threads(given.threads)
    results = Results(given.out / "results.jsonl", ("class", "budget"))
    for name in given.classes:
        if results.has(name, given.minutes):
            continue
        masks = SOURCES[name].masks(given.data)
        folder = write_folder(masks, given.out / "data" / name)
        place = given.out / "runs" / f"{name}-{given.minutes:g}"
        wrong = train(folder, place, given.minutes, given.threads)
        about = {"class": name, "budget": given.minutes, "pictures": len(masks)}
        found = {"verdict": "failed", "line": wrong} if wrong else result_of(place, given.out, name)
        results.add(about | found)
    print(table(results.rows))


if __name__ == "__main__":
    main()
