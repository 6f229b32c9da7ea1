"""Score trained arms, and the true samples that their scores are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..adversarial.assignment import Predicted
from ..data import Collection
from ..data.correlated import octave_correlations
from ..export import silhouette_sheet
from ..metrics import Score
from ..ops.maps import kind_of, pack_maps, unpack_maps
from ..recipes import rebuild
from ..training import Origin, Run, load
from ..training.evaluation import assigned_panel, evaluate, score_things
from ..training.pictures import save_picture
from ..training.run_directory import environment
from .place import Place
from .result import Result, provenance
from .sources import SOURCES

COLUMNS = 12
"""Images a view in a picture."""
COUNTS = {"volume": 512, "image": 2000, "maps": 500}
"""Domain → number of generated samples that are scored."""
DESIGNED = {(0, 1): 0.9, (2, 3): 0.9}
"""Correlations of the fields of the correlated data set (0 diffuse, 1 normal, 2 specular, 3 roughness); 0 else."""


def score(path: Path, source: str, place: Place, result: Result, fields: Mapping[str, Any]) -> None:
    """Score a finished run; store the scores and a picture of its first samples, none chosen."""
    run, seed = load(path), result.seed
    result.folder.mkdir(parents=True, exist_ok=True)
    save_picture(partial(_sample, run, seed), result.picture)
    reference = SOURCES[source].reference(place)
    samples = run.generator.sample(COUNTS[kind_of(run.generator.sample(1))], seed)
    if kind_of(samples) == "maps":  # no recipe of materials predicts views: its data need not be built again
        scores = score_materials(samples, reference, source, seed)
    else:
        scores = _score_with_views(run, reference, len(samples), result)
    result.write(scores, {**fields, "steps": run.step, "scored": scored_with(), **provenance(path)})


def _sample(run: Run, seed: int, n: int) -> Tensor:
    return run.generator.sample(n, seed)


def scored_with() -> dict[str, Any]:
    """Return the commit, time and versions of a score."""
    return {name: value for name, value in environment().items() if name in ("commit", "started", "packages")}


def _score_with_views(run: Run, reference: Tensor, count: int, result: Result) -> dict[str, Score]:
    """Return scores of samples and of predicted views, and store a picture of the latter."""
    recipe = rebuild(Origin(run.recipe["recipe"], run.recipe["arguments"]))
    if isinstance(recipe.assignment, Predicted):
        panel = assigned_panel(run, recipe)
        if panel.items.dim() == 4:
            rows = grouped(panel.items, panel.ways, len(panel.observations))
            silhouette_sheet(rows, result.views, columns=COLUMNS)
    return evaluate(run, recipe, Collection(reference), n=count, seed=result.seed, ceiling=True)


def score_materials(maps: Tensor, reference: Tensor, source: str, seed: int = 0) -> dict[str, Score]:
    """Return scores of maps; of the correlated data set also the error of its designed correlations."""
    scores = score_things(maps, reference, seed)
    return scores | octave_scores(maps) if source == "correlated" else scores


def score_truth(source: str, place: Place, truths: Mapping[str, Result], fields: Mapping[str, Any]) -> None:
    """Score and store true samples of a source, and materials whose maps belong to different materials."""
    others = SOURCES[source].others
    if others is None or truths["truth"].exists:
        return
    rng = torch.Generator().manual_seed(0)
    samples = others(place)
    samples = samples[torch.randperm(len(samples), generator=rng)[: COUNTS[kind_of(samples)]]]
    sets = {"shuffled": _shuffled(samples, rng)} if kind_of(samples) == "maps" else {}
    reference = SOURCES[source].reference(place)
    truths["truth"].folder.mkdir(parents=True, exist_ok=True)
    for name, chosen in (sets | {"truth": samples}).items():
        if not SOURCES[source].real:
            save_picture(partial(_first, chosen), truths[name].picture)
        maps = kind_of(chosen) == "maps"
        scores = score_materials(chosen, reference, source) if maps else score_things(chosen, reference)
        truths[name].write(scores, {**fields, "scored": scored_with()})


def _shuffled(maps: Tensor, rng: torch.Generator) -> Tensor:
    """Return materials with each map taken from another one."""
    return pack_maps({name: part[torch.randperm(len(part), generator=rng)] for name, part in unpack_maps(maps).items()})


def _first(samples: Tensor, n: int) -> Tensor:
    return samples[:n]


def grouped(images: Tensor, views: Tensor, bins: int) -> Tensor:
    """Return a row of COLUMNS images a view: the first ones assigned to it, and empty images behind them."""
    rows = []
    for k in range(bins):
        chosen = images[views == k][:COLUMNS]
        rows += [chosen, images.new_zeros(COLUMNS - len(chosen), *images.shape[1:])]
    return torch.cat(rows)


def octave_scores(maps: Tensor) -> dict[str, Score]:
    """Return the largest error of the mean material's correlations, over octaves and pairs of fields.

    Pairs within a group, (diffuse, normal) and (specular, roughness), and pairs across the groups are apart.
    """
    found = octave_correlations(maps).mean(0)
    pairs = [(i, j) for j in range(4) for i in range(j)]
    off = {pair: (found[:, pair[0], pair[1]] - DESIGNED.get(pair, 0.0)).abs().max().item() for pair in pairs}
    protocol = f"largest |ρ - designed| over octaves and pairs of fields {{}}, mean of {len(maps)} materials"
    groups = {"within": [off[p] for p in DESIGNED], "across": [off[p] for p in pairs if p not in DESIGNED]}
    return {
        f"octave_error_{name}": Score(max(values), protocol.format(f"{name} the two groups"), len(maps))
        for name, values in groups.items()
    }
