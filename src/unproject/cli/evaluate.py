"""`unproject evaluate RUN --json`."""

from __future__ import annotations

import json as json_module
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from .._types import UserError
from ._machine import use_threads

if TYPE_CHECKING:
    from torch import Tensor

    from ..data import Collection


def run(
    path: Path,
    /,
    *,
    reference: Path | None = None,
    n: int | None = None,
    seed: int = 0,
    ceiling: bool = False,
    json: bool = False,
    threads: int | None = None,
    trust: bool = False,
) -> None:
    """Score a run: shapes, images, or what is seen of them, against held-out ones; predicted views against true ones.

    Args:
        path: the run directory.
        reference: held-out shapes or images, silhouettes or line integrals; for the embedded chairs 200 others of
            the family, for the embedded digits the 297 that are kept for this.
        n: how many things to generate; 256 shapes or 2000 images unless given.
        seed: of what is generated and of the measurement.
        ceiling: also train a view predictor on the true views, to say what could be had.
        json: print one JSON object: metric → value, protocol, n, seed.
        threads: processor threads; all cores unless given.
        trust: import the run's code although it is not of this package.
    """
    from ..recipes import rebuild
    from ..training import Origin, load
    from ..training.evaluation import evaluate, makes_images
    from ..training.run_directory import read_recipe

    use_threads(threads)
    if n is not None and n < 1:
        raise UserError(f"--n {n}: give at least 1")
    opened = load(path, trust)
    stored = read_recipe(path)
    recipe = rebuild(Origin(stored["recipe"], stored["arguments"]), trust)
    one = opened.generator.sample(1)
    held_out = _reference(reference, stored["arguments"], one)
    scores = evaluate(opened, recipe, held_out, n or (2000 if makes_images(one) else 256), seed, ceiling)
    if json:
        print(json_module.dumps({name: asdict(score) for name, score in scores.items()}, indent=1))
        return
    for name, score in scores.items():
        print(f"{name:<16} {score.value:8.4f}   {score.protocol}")


def _reference(path: Path | None, arguments: dict[str, object], one: Tensor) -> Collection | None:
    """Held-out things: what the user names, else those kept of the embedded default if the run was trained on it."""
    from ..data import Collection, chairs, digits, read, read_images

    images, size = one.shape[1] <= 4, one.shape[-1]
    if path is not None:
        return read_images(path, size) if images else read(path, size=size)
    if arguments.get("data") is not None:
        return None
    return Collection(digits(size, held_out=True) if images else chairs(200, size, seed=1))
