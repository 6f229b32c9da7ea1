"""`unproject train RECIPE --data PATH --out RUN`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from .._types import UserError
from ._arguments import bind_recipe

if TYPE_CHECKING:
    from ..training import Origin, Recipe


def run(
    recipe: Recipe,
    origin: Origin,
    /,
    *,
    out: Path | None = None,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    threads: int | None = None,
    quiet: bool = False,
) -> None:
    """Train a recipe. The first Ctrl-C writes a checkpoint and leaves; `unproject resume` goes on from there.

    Args:
        out: the run directory to make; runs/RECIPE-SEED unless given.
        device: where to compute.
        threads: processor threads; all cores unless given.
        quiet: no progress bar.
    """
    from ..training import Recipe, train
    from ._machine import say, use_threads

    use_threads(threads)
    if not isinstance(recipe, Recipe):
        raise UserError(f"{origin.recipe} returned {type(recipe).__name__}; name a function that returns a Recipe")
    out = out or Path("runs") / f"{origin.recipe.rpartition(':')[2]}-{recipe.seed}"
    finished = train(recipe, out, origin=origin, device=device, quiet=quiet)
    say(f"{out}: {finished.step} steps; next: unproject export {out} --to png --out {out / 'sheet.png'}")


def parse(argv: Sequence[str]) -> Callable[[], Any]:
    return bind_recipe("train", argv, run)
