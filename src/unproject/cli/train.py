"""`unproject train RECIPE --data PATH --out RUN`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from ._arguments import bind_recipe

if TYPE_CHECKING:
    from ..training import Recipe


def run(
    recipe: Recipe,
    /,
    *,
    out: Path | None = None,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    threads: int | None = None,
    quiet: bool = False,
) -> None:
    """Train a recipe. The first Ctrl-C writes a checkpoint and leaves; `unproject resume` continues from there.

    Args:
        out: the run directory to make (default: runs/RECIPE-SEED).
        device: where to compute.
        threads: processor threads (default: all cores).
        quiet: no progress bar.
    """
    from ..training import train
    from ._machine import say, use_threads

    use_threads(threads)
    name = recipe.origin.recipe.rpartition(":")[2] if recipe.origin else "recipe"
    out = out or Path("runs") / f"{name}-{recipe.seed}"
    finished = train(recipe, out, device=device, quiet=quiet)
    say(f"{out}: {finished.step} steps; next: unproject export {out} --to png --out {out / 'samples.png'}")


def parse(argv: Sequence[str]) -> Callable[[], Any]:
    return bind_recipe("train", argv, run)
