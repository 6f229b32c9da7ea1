"""Arms are trained by `unproject train` in processes of their own, so many at a time, and scored when they are done."""

from __future__ import annotations

import signal
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any

from .._types import UserError
from ..training import checkpoint
from ..training.run_directory import BUDGET, read_recipe
from .budgets import flags_of
from .figure import Arm, Budget
from .kept import Kept, as_json
from .scoring import score
from .sources import SOURCES, Place

Job = tuple[Arm, int]
"""An arm and a seed."""
_SCORING = threading.Lock()
"""Weights and draws come from torch's one random state, which two scorings at a time would share."""


@dataclass(frozen=True)
class Where:
    """Folders of a reproduction, and how much of the machine it takes.

    Attributes:
        runs: run directories, one an arm and seed.
        kept: results.
        data: real collections; None for the embedded worlds.
        parallel: trainings at a time.
        threads: of each of them; all cores' share unless given.
    """

    runs: Path
    kept: Path
    data: Path | None
    budget: Budget
    parallel: int = 1
    threads: int | None = None

    def run(self, arm: Arm, seed: int) -> Path:
        return self.runs / f"{arm.name}-{seed}"

    def place(self, arm: Arm) -> Place:
        return Place(self.runs / "sources", self.data, flags_of(arm, self.budget)["size"])

    def result(self, arm: Arm, seed: int) -> Kept:
        return Kept(self.kept, arm.name, seed)

    def results(self, arm: Arm) -> dict[int, Kept]:
        """Those there are, by seed."""
        seeds = (path.stem.removeprefix(f"{arm.name}-") for path in self.kept.glob(f"{arm.name}-*.json"))
        return {int(seed): self.result(arm, int(seed)) for seed in seeds if seed.isdecimal()}

    def truths(self, source: str) -> dict[str, Kept]:
        """Of other true things, and of materials whose maps belong to different ones: what arms are to be read by."""
        return {name: Kept(self.kept, f"{name}-{source}", 0) for name in ("truth", "shuffled")}

    def about(self, arm: Arm) -> dict[str, Any]:
        """What a result must have been made of to be this arm's."""
        return {"budget": self.budget, "recipe": arm.recipe, "flags": flags_of(arm, self.budget)}


def is_kept(arm: Arm, seed: int, where: Where) -> bool:
    """Whether the result is there. Raises UserError if it is another arm's than the one of that name now."""
    kept = where.result(arm, seed)
    if kept.exists:
        kept.check(where.about(arm))
    return kept.exists


def finish(jobs: Iterable[Job], where: Where) -> None:
    """Train and score what is not yet kept. What fails does not keep the rest from being finished.

    What arms learn from is written one after another, while those that have theirs are trained.

    Raises:
        UserError: if something failed, naming each; at once, if a result is not of the arm of its name.
    """
    missing = [job for job in jobs if not is_kept(*job, where)]
    children: set[subprocess.Popen[str]] = set()
    futures: list[Future[None]] = []
    failures: list[str] = []
    with ThreadPoolExecutor(where.parallel) as pool, _leaving_none(children):
        try:
            for job in missing:
                with _saying(failures):
                    futures.append(pool.submit(_train, *job, where, command(*job, where), children))
            for future in as_completed(futures):
                with _saying(failures):
                    future.result()
        except BaseException:
            for future in futures:
                future.cancel()
            for child in children:
                child.terminate()  # it saves and leaves
            raise
    if failures:
        raise UserError("; ".join(failures))


@contextmanager
def noting(failures: list[str]) -> Iterator[None]:
    """A failure is noted, and does not keep what comes after it from being done."""
    try:
        yield
    except UserError as error:
        failures.append(str(error))


@contextmanager
def _saying(failures: list[str]) -> Iterator[None]:
    before = len(failures)
    with noting(failures):
        yield
    for failure in failures[before:]:
        print(f"failed: {failure}", flush=True)


@contextmanager
def _leaving_none(children: set[subprocess.Popen[str]]) -> Iterator[None]:
    """SIGTERM is an exception here, so that trainings are ended with the process that began them."""

    def leave(number: int, frame: FrameType | None) -> None:
        sys.exit(128 + number)

    try:
        previous = signal.signal(signal.SIGTERM, leave)
    except ValueError:  # not in the main thread: signals are someone else's business
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


def command(arm: Arm, seed: int, where: Where) -> list[str]:
    """The words of `unproject` that train an arm, or go on with it.

    Raises:
        UserError: if the run that is there is not this arm's, or what it is to learn from is missing.
    """
    out, flags = where.run(arm, seed), flags_of(arm, where.budget)
    if (out / "recipe.json").exists():
        check_run(arm, seed, where)
        words = ["resume", str(out), *_words({name: value for name, value in flags.items() if name in BUDGET})]
    else:
        sources = SOURCES[arm.source].flags(where.place(arm))
        words = ["train", arm.recipe, *_words(flags | sources | {"seed": seed, "out": out})]
    return [*words, "--quiet", *_words({"threads": where.threads} if where.threads else {})]


def check_run(arm: Arm, seed: int, where: Where) -> None:
    """Raise UserError unless the run that is there has the flags of its arm, the budget aside."""
    out, flags = where.run(arm, seed), as_json(flags_of(arm, where.budget))
    made = read_recipe(out)
    for name, value in {"recipe": arm.recipe, "seed": seed, **flags}.items():
        found = made["recipe"] if name == "recipe" else made["arguments"].get(name)
        if name not in BUDGET and found != value:
            raise UserError(
                f"{out}: was made with {name} {found}, the arm has {value}; remove that run, or give --runs"
            )


def _words(flags: Mapping[str, Any]) -> list[str]:
    """Flags of the command line; a switch that is on has no value."""
    words: list[str] = []
    for name, value in flags.items():
        several = value if isinstance(value, tuple) else () if value is True else (value,)
        words += [f"--{name.replace('_', '-')}", *map(str, several)]
    return words


def _train(arm: Arm, seed: int, where: Where, words: list[str], children: set[subprocess.Popen[str]]) -> None:
    out = where.run(arm, seed)
    print(f"{arm.name}, seed {seed}: unproject {words[0]} {words[1]}", flush=True)
    child = subprocess.Popen(
        [sys.executable, "-m", "unproject", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    children.add(child)
    _, said = child.communicate()
    children.discard(child)
    if child.returncode:
        killed = f"killed by signal {-child.returncode}" if child.returncode < 0 else "no reason given"
        line = (said.strip().splitlines() or [killed])[-1]
        raise UserError(f"{out}: training stopped: {line.removeprefix('unproject: ')}")
    if not is_finished(arm, seed, where):
        raise UserError(f"{out}: training was interrupted; the same command goes on with it")
    with _SCORING:
        score_run(arm, seed, where)


def score_finished(jobs: Iterable[Job], where: Where) -> None:
    """Score the runs that are finished and whose results are not kept, and train nothing."""
    for arm, seed in jobs:
        if not is_kept(arm, seed, where) and is_finished(arm, seed, where):
            check_run(arm, seed, where)
            score_run(arm, seed, where)


def score_run(arm: Arm, seed: int, where: Where) -> None:
    score(where.run(arm, seed), arm.source, where.place(arm), where.result(arm, seed), where.about(arm))


def is_finished(arm: Arm, seed: int, where: Where) -> bool:
    """Whether a run has spent the budget of its arm."""
    run, flags = where.run(arm, seed), flags_of(arm, where.budget)
    if not (run / "recipe.json").exists() or not checkpoint.list_checkpoints(run / "checkpoints"):
        return False
    spent = checkpoint.load(checkpoint.newest(run / "checkpoints"), "counters/")
    by_step = "steps" in flags and spent["counters/step"].item() >= flags["steps"]
    return by_step or ("minutes" in flags and spent["counters/seconds"].item() >= 60 * flags["minutes"])
