"""`unproject resume RUN`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

from ._arguments import bind
from ._machine import say
from ._processes import in_processes
from ._threads import use_threads


def run(
    path: Path,
    /,
    *,
    steps: int | None = None,
    minutes: float | None = None,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    threads: int | None = None,
    processes: int = 1,
    log: Literal["tensorboard"] | None = None,
    trust: bool = False,
    quiet: bool = False,
) -> None:
    """Continue a run from its newest checkpoint, as if it had never been stopped.

    Args:
        path: the run directory.
        steps: a new budget in steps in place of the run's own, those already done included.
        minutes: a new budget in minutes in place of the run's own, those already spent included.
        device: where to compute.
        threads: processor threads (default: as many as the run began with; others give other numbers).
        processes: processes on this machine, as many as before or not; on several machines use torchrun.
        log: tensorboard keeps the log as an event file of TensorBoard too, in PATH/tensorboard, from the first line on;
            an event file that is there is continued without this flag too.
        trust: import the recipe's code although it is not of this package.
        quiet: no progress bar, and no verdict on the screen.
    """
    from ..training import resume
    from ..training.checkpoint import newest_step
    from ..training.run_directory import threads_of
    from ._report import leave_report
    from ._verdict import conclude

    use_threads(threads, before=threads_of(path))
    before = newest_step(path / "checkpoints")
    finished = resume(path, steps=steps, minutes=minutes, device=device, trust=trust, quiet=quiet, log=log)
    already = finished.complete and finished.step == before
    spent = "; its budget was spent already: give a larger --steps or --minutes" if already else ""
    say(f"{path}: {finished.step} steps{spent}")
    conclude(finished, quiet)
    if finished.step:
        leave_report(finished, quiet)


def parse(argv: Sequence[str]) -> Callable[[], Any]:
    """Return what resumes the run, here or in several processes."""
    return in_processes("resume", argv, bind("resume", argv, run)[0])
