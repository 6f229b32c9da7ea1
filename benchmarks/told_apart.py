"""What photographs can tell of how maps go together: true materials against the same with one map, or all, exchanged.

    python benchmarks/told_apart.py --n 300

Each material keeps its maps, and one of them, or each, is taken from another: all pictures of single maps stay as they
were, and so every difference in photographs is one of how maps go together. An observation in which both sets look the
same cannot teach a generator that, whatever the network. Distances of N photographs to N of other true materials:
patches (`metrics.patch_distance`), beside that of true materials, below which nothing can be told. Writes
docs/results/materials/told-apart.json.

`--signs` does something coarser instead, to telling-signs.json: one map turned over about its own mean, its
correlations with the others turned into their opposites; and gloss, k_s and m, made to follow the diffuse map's
luminance, up or down, ρ = 0.9, whatever it followed before.

With `--score means` or `covariances` the distances are those of the statistics that `up.Matching` brings to those of
real pictures, and of how they go together between pictures, in mean squares of standard errors: about 1 of true
materials.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from results import write
from torch import Tensor

from unproject.data import observe
from unproject.metrics import patch_distance
from unproject.ops.band_statistics import band_statistics
from unproject.ops.maps import MAPS, luminance, pack_maps, unpack_maps
from unproject.recipes.material_panels import VIEWED_FROM, natural_light, observation_of
from unproject.recipes.materials import PROCEDURAL
from unproject.training.run_directory import environment

RESULTS = Path(__file__).parent.parent / "docs" / "results" / "materials"
SAMPLES, SIZE, HERE, ELSEWHERE = 32, 64, 2**40, 2**40 + 1


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=300)
    parser.add_argument("--signs", action="store_true")
    parser.add_argument("--score", choices=(*SCORES,), default="patches")
    parser.add_argument("--sets", nargs="*", default=[*PROCEDURAL])
    parser.add_argument("--seen", nargs="*", default=[], help="observations; scores go to a file named by them")
    options = parser.parse_args(argv)
    cases, name = exchanges, "told-apart"
    if options.signs:
        cases, name = turned, "telling-signs"
    score = SCORES[options.score]
    name = "-".join([name, *([] if options.score == "patches" else [options.score]), *options.seen])
    about = {"n": options.n, "samples": SAMPLES, "environment": environment()}
    light = natural_light([*VIEWED_FROM], None)
    observed = options.seen or [*VIEWED_FROM]
    table = {
        made: {seen: told_apart(made, seen, light, options.n, cases, score) for seen in observed}
        for made in options.sets
    }
    write(RESULTS / f"{name}.json", about | {"distances": table})
    columns = list(next(iter(next(iter(table.values())).values())))
    print("| data set | observation | " + " | ".join(columns) + " |\n" + "|---" * (len(columns) + 2) + "|")
    for made, rows in table.items():
        for seen, row in rows.items():
            print(f"| {made} | {seen} | " + " | ".join(f"{row[c]:.3f}" for c in columns) + " |")


Maps = dict[str, Tensor]
Cases = Callable[[Maps], dict[str, Tensor]]


def patches(found: Tensor, truth: Tensor) -> float:
    return patch_distance(found, truth).mean


def means(found: Tensor, truth: Tensor) -> float:
    """Mean square of the differences of mean statistics, in standard errors."""
    return squares(*statistics(found, truth))


def covariances(found: Tensor, truth: Tensor) -> float:
    """The same of the products of two principal components of the truth's statistics, none with itself."""
    found, truth = statistics(found, truth)
    values, vectors = torch.linalg.eigh(truth.T @ truth / len(truth))
    rank = min(COMPONENTS, len(truth) // 8)
    i, j = torch.triu_indices(rank, rank, 1)
    products = []
    for s in (found, truth):
        w = s @ vectors[:, -rank:] / values[-rank:].sqrt()
        w = w / (1 + w.square() / 9).sqrt()  # outliers would decide alone
        products.append(w[:, i] * w[:, j])
    return squares(*products)


SCORES = {"patches": patches, "means": means, "covariances": covariances}
COMPONENTS = 16


def statistics(found: Tensor, truth: Tensor) -> tuple[Tensor, Tensor]:
    """Return the statistics of pictures (N, S) with the truth's mean and deviation taken as 0 and 1."""
    deviation, centre = torch.std_mean(truth, (0, 2, 3), keepdim=True)
    s, t = (
        torch.cat([band_statistics(part) for part in ((x - centre) / deviation).split(64)]).double()
        for x in (found, truth)
    )
    unit = t.std(0).clamp_min(1e-3)
    return (s - t.mean(0)) / unit, (t - t.mean(0)) / unit


def squares(a: Tensor, b: Tensor) -> float:
    """Return the mean square of the differences of means of two samples, in standard errors."""
    error = (a.var(0) / len(a) + b.var(0) / len(b)).clamp_min(1e-12)
    return ((a.mean(0) - b.mean(0)).square() / error).mean().item()


def told_apart(
    made: str,
    seen: str,
    light: Tensor | None,
    n: int,
    cases: Cases,
    score: Callable[[Tensor, Tensor], float] = patches,
) -> dict[str, float]:
    """Return how far photographs of materials in each case are from those of other materials as they are.

    Args:
        made: name of a procedural data set.
        seen: name of an observation.
    """
    observation = observation_of(seen, light, SAMPLES)
    truth = observe(PROCEDURAL[made](n, SIZE, HERE), [observation], seed=0).items
    maps = unpack_maps(PROCEDURAL[made](n, SIZE, ELSEWHERE))
    # The same draws of lights and views for all of them: they differ in the maps alone.
    pictures = {name: observe(changed, [observation], seed=1).items for name, changed in cases(maps).items()}
    return {name: round(score(found, truth), 4) for name, found in pictures.items()}


def exchanges(maps: Maps) -> dict[str, Tensor]:
    """No map, each one, and all of them from other materials."""
    mixed = {"none": (), **{name: (name,) for name in MAPS}, "all": tuple(MAPS)}
    return {name: exchanged(maps, which) for name, which in mixed.items()}


def exchanged(maps: Maps, mixed: Sequence[str]) -> Tensor:
    """Materials whose named maps come each from another material."""
    shifts = {name: 1 + k for k, name in enumerate(mixed)}
    return pack_maps({name: part.roll(shifts.get(name, 0), 0) for name, part in maps.items()})


def turned(maps: Maps) -> dict[str, Tensor]:
    """No map, each one turned over, and gloss that follows the diffuse map."""
    upside = maps["normal"].new_tensor([-1, -1, 1])[:, None, None]
    over = {
        name: maps["normal"] * upside if name == "normal" else above(2 * mean(x) - x, x) for name, x in maps.items()
    }
    light = standardised(luminance(maps["diffuse"]))
    found = {"none": pack_maps(maps)} | {f"-{name}": pack_maps(maps | {name: x}) for name, x in over.items()}
    for name, sign in (("gloss after diffuse", 1), ("against", -1)):
        after = {}
        for gloss in ("specular", "roughness"):
            x = maps[gloss]
            field = 0.9 * sign * light + (1 - 0.9**2) ** 0.5 * standardised(x)
            after[gloss] = above(mean(x) + x.std((2, 3), keepdim=True) * field, x)
        found[name] = pack_maps(maps | after)
    return found


def mean(x: Tensor) -> Tensor:
    return x.mean((2, 3), keepdim=True)


def above(x: Tensor, like: Tensor) -> Tensor:
    """x, not below a twentieth of a map's mean: reflectances and roughness are positive."""
    return torch.maximum(x, mean(like) / 20)


def standardised(x: Tensor) -> Tensor:
    return (x - mean(x)) / x.std((2, 3), keepdim=True).clamp(min=1e-6)


if __name__ == "__main__":
    began = time.monotonic()
    main()
    print(f"{(time.monotonic() - began) / 60:.1f} minutes")
