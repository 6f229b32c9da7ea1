"""The material behind one flash photograph: `fit` against training materials and constant maps.

    unproject train wood --minutes 25 --seed 0 --threads 1 --out WOOD
    python benchmarks/fit_materials.py --run WOOD --material wood --n 40 --out OUT

n procedural materials of a seed of their own are photographed by the run's observation `flash`. Columns, with root mean
square errors of the four maps and of rendering under the four lights of `unproject evaluate`:

    fit        the best explanation; mean: of all by weight
    nearest    the nearest of 500 training materials by photograph
    constants  the mean maps of the nearest training material by mean colour

A line of JSON is written to OUT/results.jsonl; OUT/MATERIAL.png has eight materials, none chosen: true and found,
diffuse maps and renderings.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import torch
from results import Results
from torch import Tensor

import unproject as up
from unproject.domains.maps import relit
from unproject.inversion import Search, Viewing
from unproject.ops.maps import MAPS
from unproject.training.fitting import state_of, viewing_of

HELD_OUT, TRAINING = 12345, 77


def photographed(viewing: Viewing, maps: Tensor) -> Tensor:
    bins = torch.zeros(len(maps), dtype=torch.long)
    return viewing.project(maps, viewing.draw(bins, {}, torch.Generator().manual_seed(0)))


def errors(name: str, found: Tensor, true: Tensor) -> dict[str, object]:
    """Return the root mean square errors of maps (N, 8, H, W), and of renderings."""

    def rmse(a: Tensor, b: Tensor) -> float:
        return (a - b).square().mean().sqrt().item()

    lights = [rmse(a, b) for a, b in zip(relit(found).values(), relit(true).values(), strict=True)]
    return {f"{name}_{key}": rmse(found[:, at], true[:, at]) for key, at in MAPS.items()} | {f"{name}_relit": lights}


def compared(run: up.Run, given: argparse.Namespace) -> dict[str, object]:
    """Return the scores of one kind of material."""
    make = getattr(up.data, given.material)
    true, training = make(given.n, 64, HELD_OUT), make(500, 64, TRAINING)
    viewing = viewing_of(state_of(run.assignments(), "flash"), "flash")
    seen, known = photographed(viewing, true), photographed(viewing, training)
    fitter = run.fitter("flash", search=Search(starts=8, tune=30))
    _ = fitter.candidates.variance
    begin = time.process_time()
    fits = [fitter.fit(y[None]) for y in seen]
    seconds = (time.process_time() - begin) / len(fits)
    alike = training[torch.cdist(seen.mean((2, 3)), known.mean((2, 3))).argmin(1)]
    found = {
        "fit": torch.stack([fit.x[0] for fit in fits]),
        "mean": torch.stack([fit.mean for fit in fits]),
        "nearest": training[torch.cdist(seen.flatten(1), known.flatten(1)).argmin(1)],
        "constants": alike.mean((2, 3), keepdim=True).expand_as(true),
    }
    best, rows = found["fit"], [true[:8, MAPS["diffuse"]], found["fit"][:8, MAPS["diffuse"]]]
    rows += [
        x.clamp(0, 1) for pair in zip(relit(true[:8]).values(), relit(best[:8]).values(), strict=True) for x in pair
    ]
    up.export.picture_sheet(torch.cat(rows), columns=len(rows[0])).save(given.out / f"{given.material}.png")
    row: dict[str, object] = {"n": given.n, "cpu_seconds": seconds}
    for name, x in found.items():
        row |= errors(name, x, true)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--material", choices=("wood", "metal", "plastic", "fabric"), default="wood")
    parser.add_argument("--n", type=int, default=40)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    torch.set_num_threads(1)
    results = Results(given.out / "results.jsonl", ("run", "material", "n"))
    if not results.has(str(given.run), given.material, given.n):
        found = compared(up.load(given.run), given)
        results.add({"run": str(given.run), "material": given.material, **found})


if __name__ == "__main__":
    main()
