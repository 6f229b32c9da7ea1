"""`unproject evaluate RUN --json`."""

from __future__ import annotations

import json as json_module
from dataclasses import asdict
from pathlib import Path

from .._types import UserError
from ._machine import use_threads


def run(
    path: Path,
    /,
    *,
    reference: Path | None = None,
    n: int = 256,
    seed: int = 0,
    ceiling: bool = False,
    json: bool = False,
    threads: int | None = None,
    trust: bool = False,
) -> None:
    """Score a run: shapes or silhouettes against held-out ones, predicted views against true ones where known.

    Args:
        path: the run directory.
        reference: held-out shapes or silhouettes; for the embedded chairs, 200 others of the family.
        n: how many things to generate.
        seed: of what is generated and of the measurement.
        ceiling: also train a view predictor on the true views, to say what could be had.
        json: print one JSON object: metric → value, protocol, n, seed.
        threads: processor threads; all cores unless given.
        trust: import the run's code although it is not of this package.
    """
    from ..recipes import rebuild
    from ..training import Origin, load
    from ..training.evaluation import evaluate
    from ..training.run_directory import read_recipe

    use_threads(threads)
    if n < 1:
        raise UserError(f"--n {n}: give at least 1")
    opened = load(path, trust)
    stored = read_recipe(path)
    recipe = rebuild(Origin(stored["recipe"], stored["arguments"]), trust)
    one = opened.generator.sample(1)
    if one.shape[1] <= 4:
        raise UserError(f"{path}: makes images, which cannot be scored yet; look at the pictures in {path}/samples")
    scores = evaluate(opened, recipe, _reference(reference, stored["arguments"], one.shape[-1]), n, seed, ceiling)
    if json:
        print(json_module.dumps({name: asdict(score) for name, score in scores.items()}, indent=1))
        return
    for name, score in scores.items():
        print(f"{name:<16} {score.value:8.4f}   {score.protocol}")


def _reference(path: Path | None, arguments: dict[str, object], size: int):  # noqa: ANN202
    """Held-out things: what the user names, else chairs of another seed if the run was trained on chairs."""
    from ..data import Collection, chairs, read

    if path is not None:
        return read(path, size=size)
    return Collection(chairs(200, size, seed=1)) if arguments.get("data") is None else None
