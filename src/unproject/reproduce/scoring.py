"""Scores of trained arms, and of the held-out samples that they are compared with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from ..data.correlated import octave_correlations
from ..domains import Domain, Maps
from ..export import save_image, silhouette_sheet
from ..metrics import Score
from ..ops.maps import pack_maps, unpack_maps
from ..training import Run, load
from ..training.run_directory import environment
from .kept import Kept, made_by
from .sources import SOURCES, Place

EACH = 12  # images a view in a picture
SHAPES = 512
"""Shapes that are generated to be scored; of images and materials as many as their domain says."""
BY_DESIGN = {(0, 1): 0.9, (2, 3): 0.9}
"""Correlations of the partly correlated data set's fields, diffuse, normal, specular, roughness; the others' are 0."""


def score(path: Path, source: str, place: Place, kept: Kept, about: Mapping[str, Any]) -> None:
    """Score a finished run; keep the scores and a picture of its first samples, none chosen."""
    run = load(path)
    kept.folder.mkdir(parents=True, exist_ok=True)
    save_image(run.domain.preview(run.sample(run.domain.previewed, kept.seed)), kept.picture)
    reference = SOURCES[source].reference(place)
    count = scored(run.domain)
    if isinstance(run.domain, Maps):  # whose views are known: their photographs need not be built again
        scores = score_materials(run.domain, run.sample(count, kept.seed), reference, source, kept.seed)
    else:
        scores = _score_with_views(run, reference, count, kept)
    kept.write(scores, {**about, "steps": run.step, "scored": scored_with(), **made_by(path)})


def scored(domain: Domain) -> int:
    """Return how many samples of a domain are scored."""
    return SHAPES if domain.name == "volume" else domain.scored


def scored_with() -> dict[str, Any]:
    """Return when, and with which version, a score was computed."""
    return {name: value for name, value in environment().items() if name in ("commit", "started", "packages")}


def _score_with_views(run: Run, reference: Tensor, count: int, kept: Kept) -> dict[str, Score]:
    """Score samples and estimated views; keep a picture of the images of each view."""
    recipe = run.recipe()
    (state,) = run.assignments(recipe)
    views, images = state.estimates(), state.panel.collections[0]
    if views is not None and len(state.panel.shape) == 3:
        rows = grouped(images.floats(), views, len(state.panel.observations))
        silhouette_sheet(rows, kept.views, columns=EACH)
    return run.evaluate(reference, n=count, seed=kept.seed, ceiling=True, recipe=recipe)


def score_materials(domain: Domain, maps: Tensor, reference: Tensor, source: str, seed: int = 0) -> dict[str, Score]:
    """Score maps; in the data set that is correlated by design also how far its correlations are."""
    scores = domain.scores(maps, reference, seed)
    return scores | octave_scores(maps) if source == "correlated" else scores


def score_truth(source: str, place: Place, truths: Mapping[str, Kept], about: Mapping[str, Any]) -> None:
    """Score other true samples of a source, and materials whose maps are exchanged between materials."""
    others, domain = SOURCES[source].others, SOURCES[source].domain
    if others is None or truths["truth"].exists:
        return
    rng = torch.Generator().manual_seed(0)
    samples = others(place)
    samples = samples[torch.randperm(len(samples), generator=rng)[: scored(domain)]]
    sets: dict[str, Tensor] = {}
    if isinstance(domain, Maps):
        mixed = {name: part[torch.randperm(len(part), generator=rng)] for name, part in unpack_maps(samples).items()}
        sets["shuffled"] = pack_maps(mixed)
    reference = SOURCES[source].reference(place)
    truths["truth"].folder.mkdir(parents=True, exist_ok=True)
    for name, chosen in (sets | {"truth": samples}).items():
        if not SOURCES[source].real:
            save_image(domain.preview(chosen[: domain.previewed]), truths[name].picture)
        maps = isinstance(domain, Maps)
        scores = score_materials(domain, chosen, reference, source) if maps else domain.scores(chosen, reference)
        truths[name].write(scores, {**about, "scored": scored_with()})


def grouped(images: Tensor, views: Tensor, bins: int) -> Tensor:
    """Return a row of images for each view: the first ones assigned to it, the rest of the row empty."""
    rows = []
    for k in range(bins):
        chosen = images[views == k][:EACH]
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
