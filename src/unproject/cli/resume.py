"""`unproject resume RUN`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from ._machine import say, use_threads


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
        steps: a new budget in steps in place of the run's own, those already done included.
        minutes: a new budget in minutes in place of the run's own, those already spent included.
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
    changes = _budget(stored["arguments"], steps, minutes)
    recipe = rebuild(Origin(stored["recipe"], stored["arguments"]), trust, **changes)
    finished = resume(recipe, path, device=device, quiet=quiet)
    say(f"{path}: {finished.step} steps")


def _budget(arguments: dict[str, Any], steps: int | None, minutes: float | None) -> dict[str, Any]:
    """What changes for a new budget: the run's old one must not end it first."""
    given = {"steps": steps, "minutes": minutes}
    if steps is None and minutes is None:
        return {}
    return {name: value for name, value in given.items() if value is not None or name in arguments}
