"""Kill a run with SIGKILL ten times and resume it every time: `python killing.py FOLDER SEED`.

A script of its own, because forking a process that has just imported torch is clean and quick, and forking pytest
is neither. Leaves FOLDER/whole, never killed, and FOLDER/killed-0 (and -1, ... if that one finished before its ten
kills), and prints what each kill interrupted.
"""

from __future__ import annotations

import mmap
import os
import random
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch
from toy import toy

from unproject.assignment import PredictedState
from unproject.training import resume, train, trainer

PHASES = ("starting", "stepping", "assigning", "saving")
phase = mmap.mmap(-1, 1)
recipe = toy(steps=24, checkpoint_every=2, starts=(0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9))


def watched(owner: type, name: str, number: int) -> None:
    """Note, where the parent can read it, when a method is running."""
    method: Callable[..., Any] = getattr(owner, name)

    def call(*arguments: Any) -> Any:
        before, phase[0] = phase[0], number
        result = method(*arguments)
        phase[0] = before
        return result

    setattr(owner, name, call)


def go(run: Path) -> None:
    """What a child does: begin, or go on."""
    if (run / "recipe.json").exists():
        resume(run, recipe, quiet=True)
    else:
        train(recipe, run, quiet=True)


def killed_after(seconds: float, run: Path) -> bool:
    """Whether SIGKILL came before the end."""
    child = os.fork()
    if child == 0:
        go(run)
        os._exit(0)
    time.sleep(seconds)
    os.kill(child, signal.SIGKILL)
    status = os.waitpid(child, 0)[1]
    assert os.WIFSIGNALED(status) or os.WEXITSTATUS(status) == 0, "the run failed by itself"
    return os.WIFSIGNALED(status)


def main(folder: Path, seed: int, kills: int = 10) -> None:
    torch.set_num_threads(1)
    trainer.EVERY = 2
    watched(trainer.Trainer, "step", 1)
    watched(PredictedState, "_continue_round", 2)
    watched(trainer.Trainer, "save", 3)
    train(toy(steps=1), folder / "warm", quiet=True)  # what is slow once only would spoil the measure of time
    began = time.monotonic()
    go(folder / "whole")
    longest = (time.monotonic() - began) / 6
    rng, done, runs = random.Random(seed), 0, 0
    while done < kills:
        phase[0] = 0
        if killed_after(rng.uniform(0, longest), folder / f"killed-{runs}"):
            done += 1
            print(PHASES[phase[0]])
        else:
            runs += 1
    go(folder / f"killed-{runs}")


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
