"""`unproject evaluate RUN --json`."""

from __future__ import annotations

import json as json_module
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
            the family, for the embedded digits the 297 that are kept for this, for embedded materials as many others.
        n: how many things to generate; 256 shapes, 2000 images or 500 materials unless given.
        seed: of what is generated and of the measurement.
        ceiling: also train a view predictor on the true views, to say what could be had.
        json: print one JSON object: metric → value, protocol, n, seed.
        threads: processor threads; all cores unless given.
        trust: import the run's code although it is not of this package.
    """
    from ..ops.maps import kind_of
    from ..recipes import rebuild
    from ..training import Origin, load
    from ..training.evaluation import evaluate
    from ..training.run_directory import read_recipe

    use_threads(threads)
    if n is not None and n < 1:
        raise UserError(f"--n {n}: give at least 1")
    opened = load(path, trust)
    stored = read_recipe(path)
    recipe = rebuild(Origin(stored["recipe"], stored["arguments"]), trust)
    one = opened.generator.sample(1)
    count = n or MANY[kind_of(one)]
    held_out = _reference(reference, stored, one, count)
    scores = evaluate(opened, recipe, held_out, count, seed, ceiling)
    if json:
        print(json_module.dumps({name: asdict(score) for name, score in scores.items()}, indent=1))
        return
    for name, score in scores.items():
        print(f"{name:<16} {score.value:8.4f}   {score.protocol}")


MANY = {"image": 2000, "volume": 256, "maps": 500}
UNSEEN = 2**40  # the seed of materials that no recipe trains on


def _reference(path: Path | None, stored: dict[str, Any], one: Tensor, count: int) -> Collection | None:
    """Held-out things: what the user names, else those kept of the embedded default if the run was trained on it."""
    from ..data import Collection, chairs, digits, read
    from ..ops.maps import kind_of

    kind, size = kind_of(one), one.shape[-1]
    if path is not None:
        if kind == "maps":
            return Collection.materials(path, size).warn_skipped()
        return read(path, size, pictures="images" if kind == "image" else "silhouettes")
    if stored["arguments"].get("data") is not None:
        return None
    if kind == "maps":
        from ..recipes.materials import WORLDS

        world = WORLDS.get(stored["recipe"].partition("-")[0])
        return None if world is None else Collection(world(count, size, UNSEEN))
    return Collection(digits(size, held_out=True) if kind == "image" else chairs(200, size, seed=1))
