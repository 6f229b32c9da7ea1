"""`unproject train RECIPE --data PATH --out RUN`."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from .._types import UserError, is_lack_of_memory
from ._arguments import bind_recipe
from ._processes import in_processes

SLOW_STEP = 10.0
"""Seconds of a step from which on its estimate is printed."""

if TYPE_CHECKING:
    from ..training import Recipe


def run(
    recipe: Recipe,
    /,
    *,
    out: Path | None = None,
    from_: Path | None = None,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    threads: int | None = None,
    processes: int = 1,
    quiet: bool = False,
    force: bool = False,
    log: Literal["tensorboard"] | None = None,
) -> None:
    """Train a recipe. The first Ctrl-C writes a checkpoint and leaves; `unproject resume` continues from there.

    Memory and seconds of a step are estimated first, and said if steps take long. A run whose budget is spent ends with
    a verdict in one line, which verdict.json explains; report.html shows it all.

    Args:
        out: the run directory to make (default: runs/RECIPE-SEED).
        from_: a run whose weights to start from, to fine-tune its generator on other data (default: random weights).
        device: where to compute.
        threads: processor threads (default: one a core that nobody else keeps busy).
        processes: processes on this machine, one for each GPU, with a batch each; on several machines use torchrun.
        quiet: no progress bar, and no verdict on the screen.
        log: tensorboard keeps the log as an event file of TensorBoard too, in OUT/tensorboard; resume goes on with it.
        force: train although the estimate says that memory is too small.
    """
    from ..training import train
    from ..training.building import foreign_code
    from ..training.run_directory import COARSE, check_free
    from ._machine import say, warn_if_empty
    from ._report import leave_report
    from ._threads import use_threads
    from ._verdict import conclude
    from ._warnings import release

    use_threads(threads)
    _estimate(recipe, device)
    out = out or _usual(recipe.origin.recipe if recipe.origin else "recipe", recipe.seed)
    check_free(out, recipe)
    if not quiet:
        studio = f"unproject studio {shlex.quote(str(out.parent))}"
        say(f"{out}: watch it in a browser with {studio}, or look at the pictures in {out}/samples")
        if recipe.coarse is not None and from_ is None:
            say(f"{out / COARSE} is trained first, at half the size, for {recipe.coarse.share:.0%} of the budget")
    release()
    finished = train(recipe, out, start=from_, device=device, quiet=quiet, log=log)
    if not finished.step:
        why, more = ("its budget was spent", " --minutes 10") if finished.complete else ("stopped", "")
        when = "in coarse/, at half the size" if (out / COARSE).exists() else "before the first step was done"
        say(f"{out}: {why} {when}; unproject resume {shlex.quote(str(out))}{more} goes on")
        return
    warn_if_empty(finished.domain, finished.sample(finished.domain.previewed))
    stopped = "" if finished.complete else f" (stopped; unproject resume {shlex.quote(str(out))} continues)"
    say(f"{out}: {finished.step} steps{stopped}")
    conclude(finished, quiet)
    leave_report(finished, quiet)
    words = ["export", str(out), "--to", "png", "--out", str(out / "samples.png")]
    say(f"next: unproject {shlex.join(words + (['--trust'] if foreign_code(out) else []))}")


def parse(argv: Sequence[str]) -> Callable[[], Any]:
    """Return what makes the recipe, which may need memory for data, and trains it."""
    call = bind_recipe("train", argv, run, first=_refuse_taken)
    return in_processes("train", argv, _unchecked(call) if "--force" in argv else call)


def _refuse_taken(recipe: str, given: Mapping[str, Any]) -> None:
    """Raise UserError if a run cannot be made there, before minutes are spent on reading the data."""
    from ..training.run_directory import check_free

    check_free(given.get("out") or _usual(recipe, given.get("seed", 0)))


def _usual(recipe: str, seed: int) -> Path:
    return Path("runs") / f"{recipe.rpartition(':')[2]}-{seed}"


def _unchecked(call: Callable[[], Any]) -> Callable[[], Any]:
    def forced() -> Any:
        from ..training.memory import unchecked

        with unchecked():
            return call()

    return forced


def _estimate(recipe: Recipe, device: str) -> None:
    """Say what a step takes if it takes long; of parts that do not fit nothing: training says what is wrong with them.

    Raises:
        UserError: if it takes more memory than there is.
    """
    from ..training.distribution import device_of
    from ..training.estimate import estimate
    from ..training.memory import require_memory_to_train
    from ._machine import say

    place = device_of(device)
    try:
        found = estimate(recipe, place)
    except Exception as error:
        if isinstance(error, UserError) or is_lack_of_memory(error):
            raise
        return  # a part of the user's own fails; training says which
    taken = recipe.origin.arguments if recipe.origin else {}
    flags = [f"--{name}" for name in ("size", "batch", "channels") if name in taken or name == "batch"]
    require_memory_to_train(found.memory, "a training step takes", f"lower {' or '.join(flags)}", place)
    if found.seconds > SLOW_STEP:
        say(str(found))
