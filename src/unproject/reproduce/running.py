"""Arms are trained by `unproject train` in processes of their own, so many at a time, and scored when they are done."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .._types import UserError
from ..adversarial.assignment import Predicted
from ..data import Collection
from ..data.correlated import octave_correlations
from ..export import silhouette_sheet
from ..metrics import Score
from ..ops.maps import kind_of, pack_maps, unpack_maps
from ..recipes import rebuild
from ..training import Origin, Recipe, Run, checkpoint, load
from ..training.evaluation import assigned_panel, evaluate, score_things
from ..training.pictures import save_picture
from .budgets import flags_of
from .figure import Arm, Budget
from .kept import Kept, made_by, seconds_of
from .sources import SOURCES, Place

EACH = 12  # images a view in a picture
SLACK = 30.0  # seconds between the last line of a run's log and its end
MANY = {"volume": 512, "image": 2000, "maps": 500}
"""Of each kind, generated to be scored."""
BY_DESIGN = {(0, 1): 0.9, (2, 3): 0.9}
"""Correlations of the partly correlated world's fields, diffuse, normal, specular, roughness; the others' are 0."""


@dataclass(frozen=True)
class Where:
    """Folders of a reproduction, and how much of the machine it takes.

    Attributes:
        runs: run directories, one an arm and seed.
        kept: results.
        data: real collections; None for the embedded worlds.
        parallel: trainings at a time.
        threads: of each of them; all cores' share unless given.
    """

    runs: Path
    kept: Path
    data: Path | None
    budget: Budget
    parallel: int = 1
    threads: int | None = None

    def run(self, arm: Arm, seed: int) -> Path:
        return self.runs / f"{arm.name}-{seed}"

    def place(self, size: int) -> Place:
        return Place(self.runs / "sources", self.data, size)

    def result(self, arm: Arm, seed: int) -> Kept:
        return Kept(self.kept, arm.name, seed)

    def truths(self, source: str) -> dict[str, Kept]:
        """Of other true things, and of materials whose maps belong to different ones: what arms are to be read by."""
        return {name: Kept(self.kept, f"{name}-{source}", 0) for name in ("truth", "shuffled")}


def finish(jobs: Iterable[tuple[Arm, int]], where: Where) -> None:
    """Train and score what is not yet kept.

    Raises:
        UserError: if a training fails; what the others finished is kept.
    """
    missing = [(arm, seed) for arm, seed in jobs if not where.result(arm, seed).exists]
    with ThreadPoolExecutor(where.parallel) as pool:
        for _ in pool.map(lambda job: _train(job[0], job[1], where), missing):
            pass


def _words(flags: Mapping[str, Any]) -> list[str]:
    """Flags of the command line; a switch that is on has no value."""
    words: list[str] = []
    for name, value in flags.items():
        several = value if isinstance(value, tuple) else () if value is True else (value,)
        words += [f"--{name.replace('_', '-')}", *map(str, several)]
    return words


def _train(arm: Arm, seed: int, where: Where) -> None:
    out = where.run(arm, seed)
    flags = flags_of(arm, where.budget)
    flags |= SOURCES[arm.source].flags(where.place(flags["size"]))
    if (out / "recipe.json").exists():
        budget = {name: value for name, value in flags.items() if name in ("steps", "minutes")}
        words = ["resume", str(out), *_words(budget)]
    else:
        words = ["train", arm.recipe, *_words(flags | {"seed": seed, "out": out})]
    words += ["--quiet", *_words({"threads": where.threads} if where.threads else {})]
    print(f"{arm.name}, seed {seed}: unproject {words[0]} {words[1]}", flush=True)
    done = subprocess.run([sys.executable, "-m", "unproject", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        line = (done.stderr.strip().splitlines() or ["no reason given"])[-1]
        raise UserError(f"{out}: training stopped: {line.removeprefix('unproject: ')}")
    score(arm, seed, where)


def score_finished(jobs: Iterable[tuple[Arm, int]], where: Where) -> None:
    """Score the runs that are finished and whose results are not kept, and train nothing."""
    for arm, seed in jobs:
        if not where.result(arm, seed).exists and is_finished(arm, seed, where):
            score(arm, seed, where)


def is_finished(arm: Arm, seed: int, where: Where) -> bool:
    """Whether a run has spent the budget of its arm."""
    run, flags = where.run(arm, seed), flags_of(arm, where.budget)
    if not (run / "recipe.json").exists() or not checkpoint.list_checkpoints(run / "checkpoints"):
        return False
    steps = int(checkpoint.newest(run / "checkpoints").stem.removeprefix("step-"))
    enough = flags.get("steps")
    return steps >= enough if enough else seconds_of(run) >= 60 * flags["minutes"] - SLACK


def score(arm: Arm, seed: int, where: Where) -> None:
    """Score a finished run and keep the scores and a picture of the first things it makes, none chosen."""
    run = load(where.run(arm, seed))
    kept, about = where.result(arm, seed), {"budget": where.budget}
    kept.folder.mkdir(parents=True, exist_ok=True)
    one = run.generator.sample(1, seed)
    reference = SOURCES[arm.source].reference(where.place(one.shape[-1]))
    generated = run.generator.sample
    save_picture(lambda n: generated(n, seed), kept.picture)
    recipe = rebuild(Origin(run.recipe["recipe"], run.recipe["arguments"]))
    if isinstance(recipe.assignment, Predicted):
        panel = assigned_panel(run, recipe)
        if panel.items.dim() == 4:
            rows = grouped(panel.items, panel.ways, len(panel.observations))
            silhouette_sheet(rows, kept.views, columns=EACH)
    kept.write(scores_of(run, recipe, arm, reference, seed), about | {"steps": run.step} | made_by(run.path))


def score_truth(source: str, size: int, where: Where) -> None:
    """Score other true things of a source, and materials put together of different ones' maps, and keep that."""
    others, truths = SOURCES[source].others, where.truths(source)
    if others is None or truths["truth"].exists:
        return
    place, rng = where.place(size), torch.Generator().manual_seed(0)
    things = others(place)
    things = things[torch.randperm(len(things), generator=rng)[: MANY[kind_of(things)]]]
    sets: dict[str, Tensor] = {}
    if kind_of(things) == "maps":
        mixed = {name: part[torch.randperm(len(part), generator=rng)] for name, part in unpack_maps(things).items()}
        sets["shuffled"] = pack_maps(mixed)
    reference = SOURCES[source].reference(place)
    where.kept.mkdir(parents=True, exist_ok=True)
    for name, chosen in (sets | {"truth": things}).items():
        save_picture(partial(_first, chosen), truths[name].picture)
        scores = score_things(chosen, reference)
        if source == "correlated":
            scores |= octave_scores(chosen)
        truths[name].write(scores, {"budget": where.budget})


def _first(things: Tensor, n: int) -> Tensor:
    return things[:n]


def grouped(images: Tensor, ways: Tensor, bins: int) -> Tensor:
    """A row of images a view: the first ones assigned to it, the rest of the row empty."""
    rows = []
    for k in range(bins):
        chosen = images[ways == k][:EACH]
        rows += [chosen, images.new_zeros(EACH - len(chosen), *images.shape[1:])]
    return torch.cat(rows)


def scores_of(run: Run, recipe: Recipe, arm: Arm, reference: Tensor, seed: int) -> dict[str, Score]:
    """Those of `unproject evaluate`, and those of the world that is correlated by design."""
    count = MANY[kind_of(run.generator.sample(1))]
    scores = evaluate(run, recipe, Collection(reference), n=count, seed=seed, ceiling=True)
    if arm.source == "correlated":
        scores |= octave_scores(run.generator.sample(count, seed))
    return scores


def octave_scores(maps: Tensor) -> dict[str, Score]:
    """How far the correlations of the mean material are from those designed, at worst, over pairs and octaves."""
    found = octave_correlations(maps).mean(0)
    pairs = [(i, j) for j in range(4) for i in range(j)]
    off = {pair: (found[:, pair[0], pair[1]] - BY_DESIGN.get(pair, 0.0)).abs().max().item() for pair in pairs}
    how = f"largest |ρ - designed| over octaves and pairs of fields {{}}, mean of {len(maps)} materials"
    groups = {"within": [off[p] for p in BY_DESIGN], "across": [off[p] for p in pairs if p not in BY_DESIGN]}
    return {
        f"octave_error_{name}": Score(max(values), how.format(f"{name} the two groups"), len(maps))
        for name, values in groups.items()
    }
