"""What photographs can tell of how maps go together: true materials against the same with one map, or all, exchanged.

    python benchmarks/told_apart.py --n 300

Each material keeps its maps, and one of them, or each, is taken from another: all pictures of single maps stay as they
were, and so every difference in photographs is one of how maps go together. A way of looking in which both sets look
the same cannot teach a generator that, whatever the network. Distances of N photographs to N of other true materials:
patches (`metrics.patch_distance`), beside that of true materials, below which nothing can be told. Writes
docs/results/materials/told-apart.json.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path

from results import write
from torch import Tensor

from unproject.data import observe
from unproject.metrics import patch_distance
from unproject.ops.maps import MAPS, pack_maps, unpack_maps
from unproject.recipes.materials import SEEN_FROM, WORLDS, natural_light, way_of
from unproject.training.run_directory import environment

RESULTS = Path(__file__).parent.parent / "docs" / "results" / "materials"
SAMPLES, SIZE, HERE, ELSEWHERE = 32, 64, 2**40, 2**40 + 1


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--n", type=int, default=300)
    parser.add_argument("--worlds", nargs="*", default=[*WORLDS])
    options = parser.parse_args(argv)
    about = {"n": options.n, "samples": SAMPLES, "environment": environment()}
    light = natural_light([*SEEN_FROM], None)
    table = {world: {look: told_apart(world, look, light, options.n) for look in SEEN_FROM} for world in options.worlds}
    write(RESULTS / "told-apart.json", about | {"distances": table})
    columns = ("none", *MAPS, "all")
    print("| world | seen | " + " | ".join(columns) + " |\n" + "|---" * (len(columns) + 2) + "|")
    for world, rows in table.items():
        for look, row in rows.items():
            print(f"| {world} | {look} | " + " | ".join(f"{row[c]:.3f}" for c in columns) + " |")


def told_apart(world: str, look: str, light: Tensor | None, n: int) -> dict[str, float]:
    """Patch distance of photographs of materials with these maps exchanged to photographs of other materials."""
    way = way_of(look, light, SAMPLES)
    truth = observe(WORLDS[world](n, SIZE, HERE), [way], seed=0).items
    maps = unpack_maps(WORLDS[world](n, SIZE, ELSEWHERE))
    found = {}
    for name, mixed in {"none": (), **{name: (name,) for name in MAPS}, "all": tuple(MAPS)}.items():
        # The same draws of lights and views for all of them: they differ in the maps alone.
        seen = observe(exchanged(maps, mixed), [way], seed=1).items
        found[name] = round(patch_distance(seen, truth).mean, 4)
    return found


def exchanged(maps: dict[str, Tensor], mixed: Sequence[str]) -> Tensor:
    """Materials whose named maps come each from another material."""
    shifts = {name: 1 + k for k, name in enumerate(mixed)}
    return pack_maps({name: part.roll(shifts.get(name, 0), 0) for name, part in maps.items()})


if __name__ == "__main__":
    began = time.monotonic()
    main()
    print(f"{(time.monotonic() - began) / 60:.1f} minutes")
