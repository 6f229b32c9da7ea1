"""Scores of arms that are trained, and of the true things that they are to be read by."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..adversarial.assignment import Predicted
from ..data import Collection
from ..data.procedural.materials.correlated import octave_correlations
from ..export import silhouette_sheet
from ..metrics import Score
from ..ops.maps import kind_of, pack_maps, unpack_maps
from ..recipes import rebuild
from ..training import Origin, Run, load
from ..training.evaluation import assigned_panel, evaluate, score_things
from ..training.pictures import save_picture
from ..training.run_directory import environment
from .kept import Kept, made_by
from .sources import SOURCES, Place

EACH = 12  # images a view in a picture
MANY = {"volume": 512, "image": 2000, "maps": 500}
"""Of each kind, generated to be scored."""
BY_DESIGN = {(0, 1): 0.9, (2, 3): 0.9}
"""Correlations of the partly correlated world's fields, diffuse, normal, specular, roughness; the others' are 0."""


def score(path: Path, source: str, place: Place, kept: Kept, about: Mapping[str, Any]) -> None:
    """Score a finished run and keep the scores and a picture of the first things it makes, none chosen."""
    run, seed = load(path), kept.seed
    kept.folder.mkdir(parents=True, exist_ok=True)
    save_picture(partial(_sample, run, seed), kept.picture)
    reference = SOURCES[source].reference(place)
    things = run.generator.sample(MANY[kind_of(run.generator.sample(1))], seed)
    if kind_of(things) == "maps":  # whose views are never predicted: what was photographed need not be built again
        scores = score_materials(things, reference, source, seed)
    else:
        scores = _score_with_views(run, reference, len(things), kept)
    kept.write(scores, {**about, "steps": run.step, "scored": scored_with(), **made_by(path)})


def _sample(run: Run, seed: int, n: int) -> Tensor:
    return run.generator.sample(n, seed)


def scored_with() -> dict[str, Any]:
    """When, and with which version, a score was computed."""
    return {name: value for name, value in environment().items() if name in ("commit", "started", "packages")}


def _score_with_views(run: Run, reference: Tensor, count: int, kept: Kept) -> dict[str, Score]:
    """Scores of things and of the views that were predicted, of which a picture is kept."""
    recipe = rebuild(Origin(run.recipe["recipe"], run.recipe["arguments"]))
    if isinstance(recipe.assignment, Predicted):
        panel = assigned_panel(run, recipe)
        if panel.items.dim() == 4:
            rows = grouped(panel.items, panel.ways, len(panel.observations))
            silhouette_sheet(rows, kept.views, columns=EACH)
    return evaluate(run, recipe, Collection(reference), n=count, seed=kept.seed, ceiling=True)


def score_materials(maps: Tensor, reference: Tensor, source: str, seed: int = 0) -> dict[str, Score]:
    """Scores of maps; in the world that is correlated by design also how far its correlations are."""
    scores = score_things(maps, reference, seed)
    return scores | octave_scores(maps) if source == "correlated" else scores


def score_truth(source: str, place: Place, truths: Mapping[str, Kept], about: Mapping[str, Any]) -> None:
    """Score other true things of a source, and materials put together of different ones' maps, and keep that."""
    others = SOURCES[source].others
    if others is None or truths["truth"].exists:
        return
    rng = torch.Generator().manual_seed(0)
    things = others(place)
    things = things[torch.randperm(len(things), generator=rng)[: MANY[kind_of(things)]]]
    sets: dict[str, Tensor] = {}
    if kind_of(things) == "maps":
        mixed = {name: part[torch.randperm(len(part), generator=rng)] for name, part in unpack_maps(things).items()}
        sets["shuffled"] = pack_maps(mixed)
    reference = SOURCES[source].reference(place)
    truths["truth"].folder.mkdir(parents=True, exist_ok=True)
    for name, chosen in (sets | {"truth": things}).items():
        if not SOURCES[source].real:
            save_picture(partial(_first, chosen), truths[name].picture)
        maps = kind_of(chosen) == "maps"
        scores = score_materials(chosen, reference, source) if maps else score_things(chosen, reference)
        truths[name].write(scores, {**about, "scored": scored_with()})


def _first(things: Tensor, n: int) -> Tensor:
    return things[:n]


def grouped(images: Tensor, ways: Tensor, bins: int) -> Tensor:
    """A row of images a view: the first ones assigned to it, the rest of the row empty."""
    rows = []
    for k in range(bins):
        chosen = images[ways == k][:EACH]
        rows += [chosen, images.new_zeros(EACH - len(chosen), *images.shape[1:])]
    return torch.cat(rows)


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
