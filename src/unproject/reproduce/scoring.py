"""Score trained arms, and the true samples that their scores are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..data.procedural.materials.correlated import octave_correlations
from ..domains import Domain, Maps
from ..export import save_image, silhouette_sheet
from ..metrics import Score
from ..ops.maps import pack_maps, unpack_maps
from ..training import Run, load
from ..training.environment import environment
from .place import Place
from .result import Result, provenance
from .sources import SOURCES

COLUMNS = 12
"""Images a view in a picture."""
SHAPES = 512
"""Shapes that are generated to be scored; of images and materials as many as their domain says."""
DESIGNED = {(0, 1): 0.9, (2, 3): 0.9}
"""Correlations of the fields of the correlated data set (0 diffuse, 1 normal, 2 specular, 3 roughness); 0 else."""


def score(path: Path, source: str, place: Place, result: Result, fields: Mapping[str, Any]) -> None:
    """Score a finished run; store the scores and a picture of its first samples, none chosen."""
    run = load(path)
    result.folder.mkdir(parents=True, exist_ok=True)
    save_image(run.domain.preview(run.sample(run.domain.previewed, result.seed)), result.picture)
    reference, count = SOURCES[source].reference(place), scored(run.domain)
    if isinstance(run.domain, Maps):  # no recipe of materials predicts views: its data need not be built again
        scores = score_materials(run.domain, run.sample(count, result.seed), reference, source, result.seed)
    else:
        scores = _score_with_views(run, reference, count, result, SOURCES[source].real)
    result.write(scores, {**fields, "steps": run.step, "scored": scored_with(), **provenance(path)})


def scored(domain: Domain) -> int:
    """Return how many samples of a domain are scored."""
    return SHAPES if domain.name == "volume" else domain.scored


def scored_with() -> dict[str, Any]:
    """Return the commit, time and versions of a score."""
    return {name: value for name, value in environment().items() if name in ("commit", "started", "packages")}


def _score_with_views(run: Run, reference: Tensor, count: int, result: Result, real: bool) -> dict[str, Score]:
    """Return scores of samples and of predicted views; store a picture of the latter unless the data are real."""
    run = run.with_recipe()
    (state,) = run.assignments()
    views = state.estimates()
    if views is not None and len(state.panel.shape) == 3 and not real:
        rows = grouped(state.panel.collections[0].floats(), views, len(state.panel.observations))
        silhouette_sheet(rows, result.views, columns=COLUMNS)
    return run.evaluate(reference, n=count, seed=result.seed, ceiling=True)


def score_materials(domain: Domain, maps: Tensor, reference: Tensor, source: str, seed: int = 0) -> dict[str, Score]:
    """Return scores of maps; of the correlated data set also the error of its designed correlations."""
    scores = domain.scores(maps, reference, seed)
    return scores | octave_scores(maps) if source == "correlated" else scores


def score_truth(source: str, place: Place, truths: Mapping[str, Result], fields: Mapping[str, Any]) -> None:
    """Score and store true samples of a source, and materials whose maps belong to different materials."""
    others, domain = SOURCES[source].others, SOURCES[source].domain
    if others is None:
        return
    if truths["truth"].exists:
        truths["truth"].check(fields)
        return
    rng = torch.Generator().manual_seed(0)
    samples = others(place)
    samples = samples[torch.randperm(len(samples), generator=rng)[: scored(domain)]]
    maps = isinstance(domain, Maps)
    sets = {"shuffled": _shuffled(samples, rng)} if maps else {}
    reference = SOURCES[source].reference(place)
    truths["truth"].folder.mkdir(parents=True, exist_ok=True)
    for name, chosen in (sets | {"truth": samples}).items():
        if not SOURCES[source].real:
            save_image(domain.preview(chosen[: domain.previewed]), truths[name].picture)
        scores = score_materials(domain, chosen, reference, source) if maps else domain.scores(chosen, reference)
        truths[name].write(scores, {**fields, "scored": scored_with()})


def _shuffled(maps: Tensor, rng: torch.Generator) -> Tensor:
    """Return materials with each map taken from another one."""
    return pack_maps({name: part[torch.randperm(len(part), generator=rng)] for name, part in unpack_maps(maps).items()})


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
