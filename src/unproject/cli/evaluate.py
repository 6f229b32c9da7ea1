"""`unproject evaluate RUN --json`."""

from __future__ import annotations

import json as json_format
import sys
from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._types import UserError
from ._threads import use_threads
from ._verdict import verdict_of, verdict_table

FOOTNOTE_LENGTH = 40
"""Characters above which a part of several protocols becomes a footnote."""

if TYPE_CHECKING:
    from torch import Tensor

    from ..metrics import Score
    from ..training import Run


def run(
    path: Path,
    /,
    *,
    reference: Path | None = None,
    observation: str | None = None,
    n: int | None = None,
    seed: int = 0,
    ceiling: bool = False,
    json: bool = False,
    threads: int | None = None,
    trust: bool = False,
) -> None:
    """Score a run: its samples, or projections of them, against held-out ones; estimated views against known ones.

    Samples are also checked by themselves: their diversity, and whether shapes are in one piece. Without a reference
    a run on data of your own is scored by its projections against the training images, and by how well the view
    predictor knows views. The verdict is the worst of its findings.

    Args:
        path: the run directory.
        reference: held-out shapes, images or materials; or silhouettes, line integrals, or photographs of materials in
            sub-folders by their light (default: for runs without --data, held-out samples of the recipe's own data
            set).
        observation: what the references are pictures of, by the name of one of the run's observations (default: their
            shape tells, and where it does not they are samples).
        n: how many samples to score (default: 256 shapes, 2000 images or 500 materials).
        seed: of the samples and of the measurement.
        ceiling: also train a view predictor on the known views, as an upper bound.
        json: print one JSON object: metric → value, protocol, n, seed.
        threads: processor threads (default: one a core that nobody else keeps busy).
        trust: import the run's code although it is not of this package.
    """
    from ..recipes.held_out import held_out, patches_of
    from ..training import load
    from ..training.given_pictures import references
    from ..training.origin import read_origin

    use_threads(threads)
    if n is not None and n < 1:
        raise UserError(f"--n {n}: give at least 1")
    opened = load(path, trust=trust).with_recipe()
    size, count, origin = opened.sample(1).shape[-1], n or opened.domain.scored, read_origin(path)
    seen = {panel.observations[0].name: panel.shape for panel in opened.recipe().panels}
    if observation is not None:
        if reference is None:
            raise UserError(f"--observation {observation}: names what --reference holds pictures of; give that too")
        against = references(opened, reference, observation)
    elif reference is not None and (lights := _photographs_of(opened, reference, seen)):
        against = _photographs(reference, lights, size, seen)
    elif reference is not None:
        patches = patches_of(opened.domain, origin, reference, size, count)
        against = references(opened, reference) if patches is None else patches
    else:
        against = held_out(origin, size, count)
    _check_several(reference, against, opened)
    scores = opened.evaluate(against, n=count, seed=seed, ceiling=ceiling)
    if ceiling and "view_ceiling_exact" not in scores:
        none = "needs predicted views, and pictures whose true views are known"
        print(f"warning: --ceiling: {none}", file=sys.stderr)
    verdict = verdict_of(opened, seed)
    if json:
        all_scores = scores | (verdict.scores() if verdict else {})
        print(json_format.dumps({name: asdict(score) for name, score in all_scores.items()}, indent=1))
        return
    print(table(scores))
    if verdict is not None:
        print(verdict_table(verdict))
    if against is None:
        print("Self-checks only; --reference, held-out samples or projections, adds distances to them.")


def _photographs_of(run: Run, path: Path, seen: Mapping[str, tuple[int, ...]]) -> list[str]:
    """Return the sub-folders by light, and of maps, that a run of materials has observations for.

    Raises:
        UserError: if it has none for any of them, and they are no texture sets.
    """
    from ..data import holds_textures, photographed

    names = photographed(path) if run.domain.name == "maps" else ()
    chosen = [name for name in names if name in seen]
    if names and not chosen and not holds_textures(path):
        known = "all maps together; give materials" if "itself" in seen else f"{', '.join(seen)}; give some of those"
        raise UserError(f"{path}: holds pictures of {', '.join(names)}, but the run saw {known}")
    return chosen


def _photographs(path: Path, names: list[str], size: int, seen: Mapping[str, tuple[int, ...]]) -> dict[str, Tensor]:
    """Return the pictures of these sub-folders.

    Raises:
        UserError: for one that holds a single picture.
    """
    from ..data import Collection

    coloured = seen.get("specular", (1,))[0] == 3
    read = {name: Collection.photographs(path, name, size, coloured=coloured).warn_skipped() for name in names}
    few = next((name for name, found in read.items() if len(found) < 2), None)
    if few is not None:
        raise UserError(f"{path / few}: holds one picture that can be used; give two at least")
    return {name: found.floats() for name, found in read.items()}


def _check_several(path: Path | None, found: Any, run: Run) -> None:
    """Refuse a single picture, by itself or of an observation: only samples are compared with one."""
    from torch import Tensor

    parts = () if path is None else found.values() if isinstance(found, dict) else [found]
    for part in parts:
        shape = part.shape[1:] if isinstance(part, Tensor) else part.shape
        if len(part) == 1 and tuple(shape) != tuple(run.sample(1).shape[1:]):
            raise UserError(f"{path}: holds one picture that can be used; give two at least")


def table(scores: Mapping[str, Score]) -> str:
    """Return the scores and their protocols, a line each; long parts that several have in common are footnotes.

    Scores of equally many samples and references are left out where they are those of all.
    """
    scores = {name: score for name, score in scores.items() if not _is_repeated(name, scores)}
    parts = {name: score.protocol.split(", ") for name, score in scores.items()}
    counts = Counter(part for own in parts.values() for part in own)
    common = [part for part, count in counts.items() if count > 1 and len(part) > FOOTNOTE_LENGTH]
    marks = {part: f"[{k}]" for k, part in enumerate(common, 1)}
    width = max(map(len, scores), default=0)
    lines = [
        f"{name:<{width}} {score.value:9.4f}   {', '.join(marks.get(part, part) for part in parts[name])}"
        for name, score in scores.items()
    ]
    return "\n".join([*lines, "", *(f"{mark} {part}" for part, mark in marks.items())])


def _is_repeated(name: str, scores: Mapping[str, Score]) -> bool:
    all_of_them = scores.get(name.removesuffix("_equal"))
    return name.endswith("_equal") and all_of_them is not None and all_of_them.value == scores[name].value
