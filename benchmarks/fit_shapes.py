"""The shape behind a silhouette: `fit` against the nearest training shape and the best of 512 samples.

    python benchmarks/fit_shapes.py --data SHARED --runs RESULTS/runs --classes desk night_stand --n 50 --out OUT

RESULTS are those of any_class.py, of its seed 0 and of --minutes and --shapes as given there: runs on cropped
silhouettes are given one cropped silhouette of each of n held-out shapes, at an unknown azimuth; runs with known views
four silhouettes as they are, at known azimuths. Scores are the mean IoU with the true shape at 32³, all at one size, in
that one of four turns that is best for all shapes of a column together (the gauge of a run is free; training shapes
need none), and their standard errors. COLUMN_new are those of shapes of which there is no copy among the training
shapes (IoU above 0.9), as there is of some in ModelNet; COLUMN_hull those of visual hulls, which are all that level
silhouettes tell of a shape:

    fit       the best explanation, and the mean of all by weight at ½
    sample    the best of 512 samples by the distance of silhouettes, over 64 azimuths (or those known)
    nearest   the nearest training shape in the same way
    hull      of the silhouettes, of known views
    copied    the share of shapes of which there are copies
    kind      the share of silhouettes that are called of another kind, of this class and of birds

A line of JSON a class and form is written to OUT/results.jsonl; one that is there with the same minutes and shapes is
left out.
"""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Sequence
from pathlib import Path

import any_class
import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

import unproject as up
from unproject.inversion import DOUBTFUL, Search, Viewing
from unproject.ops import unit_sized, visual_hull
from unproject.training.fitting import novelty_of

VIEWS, GRID = 4, 64


def halved(volumes: Tensor) -> Tensor:
    """Return volumes (N, 64, 64, 64) at 32³."""
    return F.avg_pool3d(volumes.float()[:, None], 2)[:, 0]


def ious(found: Tensor, true: Tensor, turns: Sequence[int]) -> Tensor:
    """Return (N,) the IoU at ½, all at one size, in the turn about the vertical axis that is best for their mean."""
    a, b = unit_sized(found.float()), unit_sized(true) > 0.5
    scores = []
    for turn in turns:
        solid = torch.rot90(a, turn, (1, 3)) > 0.5
        scores.append((solid & b).flatten(1).sum(1) / (solid | b).flatten(1).sum(1).clamp_min(1))
    return max(scores, key=lambda score: score.mean().item())


def column(name: str, found: Tensor, true: Tensor, turns: Sequence[int], copied: Tensor) -> dict[str, float]:
    """Return the scores of a column: of all shapes and of those without copies, as they are and as hulls."""
    solid, whole = (visual_hull((unit_sized(x.float()) > 0.5).float()) for x in (found, true))
    of = {name: ious(found, true, turns), f"{name}_hull": ious(solid, whole, turns)}
    if (~copied).sum() > 1:
        of |= {f"{key}_new": scores[~copied] for key, scores in of.items()}
    errors = {f"{key}_error": (scores.std() / math.sqrt(len(scores))).item() for key, scores in of.items()}
    return {key: scores.mean().item() for key, scores in of.items()} | errors


def pictures_of(volumes: Tensor, azimuth: Tensor) -> Tensor:
    """Return binary silhouettes (N, M, 64, 64) at azimuths (N, M)."""
    seen = [up.Silhouette(size=64)(volumes.float(), azimuth=azimuth[:, k]) for k in range(azimuth.shape[1])]
    return (torch.stack(seen, 1)[:, :, 0] > 0.5).float()


def nearest(shapes: Tensor, viewing: Viewing, pictures: Tensor, azimuth: Tensor | None) -> Tensor:
    """Return for pictures (N, M, 1, H, W) the row of the nearest shape, at the best azimuths, or those given (N, M)."""
    grid = torch.arange(GRID) * 2 * math.pi / GRID if azimuth is None else azimuth.flatten()
    found = torch.empty(0)
    table = torch.zeros(len(pictures), len(shapes))
    for k, angle in enumerate(grid):
        theta = {"azimuth": angle.expand(len(shapes)), "elevation": torch.zeros(len(shapes))}
        y = viewing.project(shapes, theta).flatten(1)
        if azimuth is None:
            distance = torch.cdist(pictures.flatten(0, 1).flatten(1), y).square().view(len(pictures), -1, len(shapes))
            found = distance if k == 0 else torch.minimum(found, distance)
        else:
            row, m = divmod(k, azimuth.shape[1])
            table[row] += (pictures[row, m].flatten() - y).square().sum(1)
    return (found.sum(1) if azimuth is None else table).argmin(1)


def hulls(pictures: Tensor, azimuth: Tensor) -> Tensor:
    """Return all that lies within silhouettes (N, M, 1, 32, 32) of level views at azimuths (N, M)."""
    line = (torch.arange(any_class.SIZE) + 0.5) * 2 / any_class.SIZE - 1
    x, y, z = torch.meshgrid(line, line, line, indexing="ij")
    inside = torch.ones(len(pictures), *x.shape)
    for m in range(pictures.shape[1]):
        cos, sin = (f(azimuth[:, m])[:, None, None, None] for f in (torch.cos, torch.sin))
        across = x * cos - z * sin
        place = torch.stack([across, -y.expand_as(across)], -1).flatten(2, 3)
        seen = F.grid_sample(pictures[:, m], place, align_corners=False)[:, 0].view_as(inside)
        inside = inside * (seen > 0.5)
    return inside


def scored(name: str, form: str, args: argparse.Namespace) -> dict[str, object]:
    """Return the scores of a class and form."""
    run = up.load(args.runs / any_class.name_of(name, args.shapes, form, args.minutes, 0))
    train, test = any_class.volumes_of(name, args.data, args.shapes)
    true = halved(test[: args.n])
    rng = torch.Generator().manual_seed(5)
    azimuth = 2 * math.pi * torch.rand(len(true), 1 if form == "cropped" else VIEWS, generator=rng)
    fitter = run.fitter(search=Search(starts=8, tune=30))
    raw = pictures_of(test[: args.n], azimuth)
    if form == "cropped":
        pictures = fitter.viewing.projection.prepare(raw.flatten(0, 1)[:, None]).unflatten(0, raw.shape[:2])
    else:
        pictures = F.avg_pool2d(raw, 2)[:, :, None]
    known = None if form == "cropped" else azimuth
    _ = fitter.candidates.variance
    begin = time.perf_counter()
    fits = [fitter.fit(y, None if known is None else {"azimuth": known[k]}) for k, y in enumerate(pictures)]
    seconds = (time.perf_counter() - begin) / len(fits)
    samples, shapes = run.sample(512, seed=11), halved(train)
    turns = range(4) if form == "cropped" else (0,)
    best = nearest(samples, fitter.viewing, pictures, known)
    copied = any_class.are_copied(unit_sized(true), unit_sized(shapes))
    columns = {
        "fit": (torch.stack([fit.x[0] for fit in fits]), turns),
        "mean": (torch.stack([fit.mean for fit in fits]), turns),
        "sample": (samples[best], turns),
        "nearest": (shapes[nearest(shapes, fitter.viewing, pictures, known)], (0,)),
    }
    if known is not None:
        columns["hull"] = (hulls(pictures, known), (0,))
    row: dict[str, object] = {
        "distance": float(np.mean([fit.error for fit in fits])),
        "seconds": seconds,
        "copied": copied.float().mean().item(),
    }
    for key, (found, turned) in columns.items():
        row |= column(key, found, true, turned, copied)
    return {
        "class": name,
        "form": form,
        "n": len(true),
        **row,
        **of_another_kind(run, fitter.viewing, form, pictures, args),
    }


def of_another_kind(
    run: up.Run, viewing: Viewing, form: str, pictures: Tensor, args: argparse.Namespace
) -> dict[str, float]:
    """Return the shares of pictures called of another kind, of a run on cropped silhouettes."""
    if form != "cropped":
        return {}
    with np.load(args.data / "silhouettes" / "bird_cub_aves_64.npz") as arrays:
        birds = viewing.projection.prepare(torch.from_numpy(arrays["sil"]).float().clamp(0, 1)[:, None])
    novelty = novelty_of(run.assignments()[0], viewing)
    assert novelty is not None  # there is more than one picture
    own, others = (novelty.p_values(y) < DOUBTFUL for y in (pictures[:, 0], birds))
    return {"kind": own.float().mean().item(), "kind_birds": others.float().mean().item()}


def main() -> None:
    parser = argparse.ArgumentParser(description="The shape behind a silhouette.")
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--runs", type=Path, required=True)
    parser.add_argument("--classes", nargs="+", default=["desk"])
    parser.add_argument("--forms", nargs="+", default=["cropped"], choices=("cropped", "known"))
    parser.add_argument("--n", type=int, default=50)
    parser.add_argument("--shapes", type=int, default=any_class.SHAPES, help="training shapes of a class, at most")
    parser.add_argument("--minutes", type=float, default=20.0, help="of the runs")
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    file = args.out / "results.jsonl"
    there = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    for name in args.classes:
        for form in args.forms:
            arm = {"class": name, "form": form, "budget": args.minutes, "shapes": args.shapes}
            if any(row | arm == row for row in there):
                continue
            line = json.dumps(arm | scored(name, form, args))
            print(line, flush=True)
            with file.open("a") as out:
                out.write(line + "\n")


if __name__ == "__main__":
    main()
