"""`unproject resume RUN`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from ._machine import use_threads


def run(
    path: Path,
    /,
    *,
    steps: int | None = None,
    minutes: float | None = None,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    threads: int | None = None,
    trust: bool = False,
    quiet: bool = False,
) -> None:
    """Go on with a run from its newest checkpoint, as if it had never been stopped.

    Args:
        path: the run directory.
        steps: a new budget in steps; the run's own unless given.
        minutes: a new budget in minutes, those already spent included.
        device: where to compute.
        threads: processor threads; all cores unless given.
        trust: import the recipe's code although it is not of this package.
        quiet: no progress bar.
    """
    from ..recipes import rebuild
    from ..training import Origin, resume
    from ..training.run_directory import read_recipe

    use_threads(threads)
    stored = read_recipe(path)
    changes: dict[str, Any] = {k: v for k, v in (("steps", steps), ("minutes", minutes)) if v is not None}
    recipe = rebuild(Origin(stored["recipe"], stored["arguments"]), trust, **changes)
    finished = resume(recipe, path, device=device, quiet=quiet)
    print(f"{path}: {finished.step} steps")
