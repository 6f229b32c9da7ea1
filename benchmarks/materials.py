"""The seed's Figs. 7 to 11: what a generator of materials learns from which observations, side by side.

    python benchmarks/materials.py --steps 1000 --seeds 2 --parallel 2 --threads 1

====================== =================================================================================================
arm                    learned from
====================== =================================================================================================
multi (Figs. 7, 8)     wood: 500 pictures of each map, 167 renderings each under a flash, coloured lamps, ambient light
joint (Fig. 7)         wood: 625 materials with all four maps, one discriminator
natural (Figs. 7, 8)   wood: as multi, but the renderings as in the seed: natural light, from the top and grazing
selections (Fig. 8)    wood: 500 pictures of each map
correlated (Fig. 8)    the partly correlated world: as multi
few (Fig. 9)           wood: as multi, 250 pictures of each map, 250 renderings each
many (Fig. 9)          wood: as multi, 250 pictures of each map, 8000 renderings each
lights (Fig. 9)        no maps: 6000 frontal renderings each under a flash, a lamp, natural and constant light
metal, plastic         1000 pictures of each map, 5000 photographs each from the top and grazing: renderings under
                       probes that training does not have
====================== =================================================================================================

With `--data` (shared/data) also `woodreal`: patches of the CC0 sets of wood, and its albedos as the diffuse maps; and
the photographs of metal and plastic are lit by real probes, every other of which training has.

Each arm is `unproject train` with the same networks and as many steps. It is scored with 500 materials against 500 of
the world that no arm has seen, and so are 500 other true materials (arm `truth`), and true ones whose maps are
shuffled (arm `shuffled`: what selections alone can know). Arms that are finished are not computed again:
docs/results/materials/ARM-SEED.json. The sheets there show the first materials of a seed, none chosen: diffuse,
specular, roughness, normal, and renderings under a flash, in a studio, by a window, under the sky.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch
from results import write
from torch import Tensor

from unproject.export import material_sheet
from unproject.metrics import map_correlations, material_scores
from unproject.ops.maps import MAPS, pack_maps, unpack_maps
from unproject.recipes.materials import WORLDS
from unproject.reproduce.kept import made_by
from unproject.reproduce.sources import SOURCES, Place
from unproject.training import load
from unproject.training.pictures import relit

RESULTS = Path(__file__).parent.parent / "docs" / "results" / "materials"
LIGHTS = ("flash", "lamp", "top", "ambient")
ARMS: dict[str, tuple[str, dict[str, Any]]] = {
    "multi": ("wood", {"renderings": 167}),
    "joint": ("wood", {"views": "direct", "renderings": 167}),
    "natural": ("wood", {"looks": (*MAPS, "top", "grazing")}),
    "selections": ("wood", {"looks": tuple(MAPS)}),
    "correlated": ("correlated", {"renderings": 167}),
    "few": ("wood", {"maps": 250}),
    "many": ("wood", {"maps": 250, "renderings": 8000}),
    "lights": ("wood", {"looks": LIGHTS, "renderings": 6000}),
    "metal": ("metal", {"maps": 1000, "renderings": 5000}),
    "plastic": ("plastic", {"maps": 1000, "renderings": 5000}),
    "woodreal": ("wood", {"maps": 2000, "renderings": 2000}),
}
SCORED, SIZE, SHOWN = 500, 64, 10
UNSEEN = 2**41  # not the 2**40 of `unproject evaluate`, on which the recipe was chosen
PICTURES = 5 * 10**4  # seeds of what is photographed


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, help="shared/data: real probes and sets")
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--parallel", type=int, default=1, help="runs at a time")
    parser.add_argument("--threads", type=int, default=2, help="threads a run")
    parser.add_argument("--runs", type=Path, default=Path("runs/materials"))
    parser.add_argument("--arms", nargs="*", default=[arm for arm in ARMS if arm != "woodreal"])
    options = parser.parse_args(argv)
    RESULTS.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(options.threads)
    jobs = [(arm, seed) for seed in range(options.seeds) for arm in options.arms if not result(arm, seed).exists()]
    with ThreadPoolExecutor(options.parallel) as pool:
        for _ in pool.map(lambda job: run(job[0], job[1], options), jobs):
            pass
        for _ in pool.map(baselines, ("wood", "correlated", "metal", "plastic")):
            pass
    print(table())


def result(arm: str, seed: int) -> Path:
    return RESULTS / f"{arm}-{seed}.json"


def run(arm: str, seed: int, options: argparse.Namespace) -> None:
    """Train, then score in a process of its own."""
    out = options.runs / f"{arm}-{seed}"
    if (out / "recipe.json").exists():
        command = ["resume", str(out), "--steps", str(options.steps)]
    else:
        world, flags = ARMS[arm]
        flags = {"steps": options.steps, "seed": seed, "out": out} | flags | pictures_of(arm, options)
        command = ["train", world, *[part for key, value in flags.items() for part in (f"--{key}", *_said(value))]]
    subprocess.run(
        [sys.executable, "-m", "unproject", *command, "--quiet", "--threads", str(options.threads)], check=True
    )
    score(arm, seed, out)


def _said(value: Any) -> list[str]:
    return [*value] if isinstance(value, tuple) else [str(value)]


def pictures_of(arm: str, options: argparse.Namespace) -> dict[str, Path]:
    """`--data` and `--probes` of the arms that learn from pictures in folders; these are written first."""
    if arm not in ("metal", "plastic", "woodreal"):
        return {}
    learned_from, _ = SOURCES["wood-real" if arm == "woodreal" else arm]
    return learned_from(Place(options.runs, options.data, SIZE))


def score(arm: str, seed: int, out: Path) -> None:
    """Against materials of the world that no arm has seen."""
    generator = load(out)
    found = generator.generator.sample(SCORED, seed)
    sheet(generator.generator.sample(SHOWN, seed), RESULTS / f"{arm}-{seed}.jpg")
    scores: dict[str, Any] = {}
    if arm != "woodreal":
        scores = scored(found, world_of(ARMS[arm][0]), seed)
    about = {"arm": arm, "seed": seed, "steps": generator.step} | made_by(out)
    write(result(arm, seed), about | {"scores": scores, "correlations": correlations(found)})


def scored(found: Tensor, truth: Tensor, seed: int) -> dict[str, Any]:
    """Scores of maps and of two renderings, under a flash and in a studio."""
    pictures = {name: (relit(found)[k], relit(truth)[k]) for k, name in enumerate(("flash", "studio"))}
    return {name: asdict(value) for name, value in material_scores(found, truth, seed, pictures).items()}


def world_of(world: str) -> Tensor:
    return WORLDS[world](SCORED, SIZE, UNSEEN)


def correlations(maps: Tensor) -> dict[str, Any]:
    """The correlations between maps, scale by scale."""
    table = map_correlations(maps)
    return {"scales": table.scales, "values": [[round(v, 4) for v in row] for row in table.values.tolist()]}


def baselines(world: str) -> None:
    """Other true materials, and these with their maps shuffled, against the same truth."""
    others = WORLDS[world](SCORED, SIZE, UNSEEN + 1)
    rng = torch.Generator().manual_seed(0)
    mixed = {name: part[torch.randperm(SCORED, generator=rng)] for name, part in unpack_maps(others).items()}
    for arm, maps in (("truth", others), ("shuffled", pack_maps(mixed))):
        path = RESULTS / f"{arm}-{world}.json"
        if not path.exists():
            scores = scored(maps, world_of(world), 0)
            write(path, {"arm": f"{arm} {world}", "scores": scores, "correlations": correlations(maps)})
            sheet(maps[:SHOWN], RESULTS / f"{arm}-{world}.jpg")


def sheet(maps: Tensor, path: Path) -> None:
    material_sheet(maps, relit(maps), path)


COLUMNS = (
    *(f"patch_{name}" for name in (*MAPS, "flash", "studio")),
    *("correlation_error", "diversity", "precision", "recall", "coverage"),
)


def table() -> str:
    """All results so far, as Markdown."""
    lines = ["| arm | seed | steps | " + " | ".join(COLUMNS) + " |", "|---" * (len(COLUMNS) + 3) + "|"]
    for file in sorted(RESULTS.glob("*.json")):
        content = json.loads(file.read_text())
        if "scores" not in content:  # told-apart.json and its like are no arms
            continue
        cells = [f"{content['scores'][c]['value']:.3f}" if c in content["scores"] else "" for c in COLUMNS]
        first = [content["arm"], str(content.get("seed", "")), str(content.get("steps", ""))]
        lines.append("| " + " | ".join(first + cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    began = time.monotonic()
    main()
    print(f"{(time.monotonic() - began) / 60:.1f} minutes")
