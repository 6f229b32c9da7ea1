"""Train arms by `unproject train` in child processes, several at a time, and score each when it is finished."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any

from .._parent import PARENT
from .._types import UserError
from ..training import checkpoint
from ..training.run_directory import BUDGET, read_recipe
from .budgets import flags_of
from .figure import Arm, Budget
from .place import Place
from .result import Result, as_json
from .scoring import score
from .sources import SOURCES

Job = tuple[Arm, int]
"""An arm and a seed."""
_SCORING = threading.Lock()
"""Held while scoring: weights and draws come from torch's global random state."""


@dataclass(frozen=True)
class Settings:
    """Folders of a reproduction, and its share of the machine.

    Attributes:
        runs: folder of the run directories, one an arm and seed.
        results_folder: folder of the results.
        data: folder of real collections; None: the embedded data sets alone.
        budget: cpu or gpu.
        parallel: trainings at a time.
        threads: of each training; default: those that torch chooses.
    """

    runs: Path
    results_folder: Path
    data: Path | None
    budget: Budget
    parallel: int = 1
    threads: int | None = None

    def run(self, arm: Arm, seed: int) -> Path:
        return self.runs / f"{arm.name}-{seed}"

    def place(self, arm: Arm) -> Place:
        return Place(self.runs / "sources", self.data, flags_of(arm, self.budget)["size"])

    def result(self, arm: Arm, seed: int) -> Result:
        return Result(self.results_folder, arm.name, seed)

    def results(self, arm: Arm) -> dict[int, Result]:
        """Return the stored results of an arm by seed."""
        stems = (path.stem.removeprefix(f"{arm.name}-") for path in self.results_folder.glob(f"{arm.name}-*.json"))
        return {int(seed): self.result(arm, int(seed)) for seed in stems if seed.isdecimal()}

    def truths(self, source: str) -> dict[str, Result]:
        """Return the results of true samples, and of materials whose maps belong to different materials."""
        return {name: Result(self.results_folder, f"{name}-{source}", 0) for name in ("truth", "shuffled")}

    def fields(self, arm: Arm) -> dict[str, Any]:
        """Return the fields that a result of this arm must have."""
        return {"budget": self.budget, "recipe": arm.recipe, "flags": flags_of(arm, self.budget)}


def has_result(arm: Arm, seed: int, settings: Settings) -> bool:
    """Return whether the result exists.

    Raises:
        UserError: it belongs to an arm of the same name with other flags.
    """
    result = settings.result(arm, seed)
    if result.exists:
        result.check(settings.fields(arm))
    return result.exists


def train_missing(jobs: Iterable[Job], settings: Settings) -> None:
    """Train and score the jobs that have no result. A job that fails does not stop the others.

    Training data that must be written first are written one after another, while other jobs train.

    Raises:
        UserError: naming each job that failed; or at once, if a result belongs to other flags.
    """
    missing = [job for job in jobs if not has_result(*job, settings)]
    training = _Training(settings)
    with ThreadPoolExecutor(settings.parallel) as pool, _exit_on_sigterm():
        try:
            training.submit(missing, pool)
        except BaseException:
            training.cancel()
            raise
    if training.failures:
        raise UserError("; ".join(training.failures))


@dataclass
class _Training:
    """Child processes that train, and the failures so far."""

    settings: Settings
    children: set[subprocess.Popen[str]] = field(default_factory=set)
    futures: list[Future[None]] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)

    def submit(self, jobs: Iterable[Job], pool: ThreadPoolExecutor) -> None:
        for job in jobs:
            with self._printing_failures():
                self.futures.append(pool.submit(self.train, *job, command(*job, self.settings)))
        for future in as_completed(self.futures):
            with self._printing_failures():
                future.result()

    def train(self, arm: Arm, seed: int, words: list[str]) -> None:
        print(f"{arm.name}, seed {seed}: unproject {words[0]} {words[1]}", flush=True)
        out = self.settings.run(arm, seed)
        code, errors = self._wait(words)
        if code:
            reason = f"killed by signal {-code}" if code < 0 else "no reason given"
            line = (errors.strip().splitlines() or [reason])[-1]
            raise UserError(f"{out}: training stopped: {line.removeprefix('unproject: ')}")
        if not is_finished(arm, seed, self.settings):
            raise UserError(f"{out}: training was interrupted; the same command goes on with it")
        with _SCORING:
            score_run(arm, seed, self.settings)

    def _wait(self, words: list[str]) -> tuple[int, str]:
        """Run `unproject` with these words; return its exit status and what it wrote to stderr."""
        child = subprocess.Popen(
            [sys.executable, "-m", "unproject", *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, PARENT: str(os.getpid())},
        )
        self.children.add(child)
        _, errors = child.communicate()
        self.children.discard(child)
        return child.returncode, errors

    def cancel(self) -> None:
        for future in self.futures:
            future.cancel()
        for child in list(self.children):  # threads take theirs out meanwhile
            child.terminate()  # it saves a checkpoint and exits

    @contextmanager
    def _printing_failures(self) -> Iterator[None]:
        before = len(self.failures)
        with collecting(self.failures):
            yield
        for failure in self.failures[before:]:
            print(f"failed: {failure}", flush=True)


@contextmanager
def collecting(failures: list[str]) -> Iterator[None]:
    """Append the message of a UserError to `failures` and go on behind the block."""
    try:
        yield
    except UserError as error:
        failures.append(str(error))


@contextmanager
def _exit_on_sigterm() -> Iterator[None]:
    """Raise SystemExit on SIGTERM, so that the child processes are terminated too."""

    def leave(number: int, frame: FrameType | None) -> None:
        sys.exit(128 + number)

    try:
        previous = signal.signal(signal.SIGTERM, leave)
    except ValueError:  # only the main thread may set a handler
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous)


def command(arm: Arm, seed: int, settings: Settings) -> list[str]:
    """Return the arguments of `unproject` that train an arm, or resume its run.

    Raises:
        UserError: the run was started with other flags, or training data are missing.
    """
    out, flags = settings.run(arm, seed), flags_of(arm, settings.budget)
    if (out / "recipe.json").exists():
        check_run(arm, seed, settings)
        words = ["resume", str(out), *_words({name: value for name, value in flags.items() if name in BUDGET})]
    else:
        sources = SOURCES[arm.source].flags(settings.place(arm))
        words = ["train", arm.recipe, *_words(flags | sources | {"seed": seed, "out": out})]
    return [*words, "--quiet", *_words({"threads": settings.threads} if settings.threads else {})]


def check_run(arm: Arm, seed: int, settings: Settings) -> None:
    """Raise UserError unless the run was started with the flags of its arm; the budget may differ."""
    out, flags = settings.run(arm, seed), as_json(flags_of(arm, settings.budget))
    stored = read_recipe(out)
    for name, value in {"recipe": arm.recipe, "seed": seed, **flags}.items():
        found = stored["recipe"] if name == "recipe" else stored["arguments"].get(name)
        if name not in BUDGET and found != value:
            raise UserError(
                f"{out}: was made with {name} {found}, the arm has {value}; remove that run, or give --runs"
            )


def _words(flags: Mapping[str, Any]) -> list[str]:
    """Return flags as words of the command line; a switch that is on has no value."""
    words: list[str] = []
    for name, value in flags.items():
        several = value if isinstance(value, tuple) else () if value is True else (value,)
        words += [f"--{name.replace('_', '-')}", *map(str, several)]
    return words


def score_finished(jobs: Iterable[Job], settings: Settings) -> None:
    """Score finished runs that have no result; train nothing.

    Raises:
        UserError: naming each run that cannot be scored, once all others are.
    """
    failures: list[str] = []
    for arm, seed in jobs:
        with collecting(failures):
            if not has_result(arm, seed, settings) and is_finished(arm, seed, settings):
                check_run(arm, seed, settings)
                score_run(arm, seed, settings)
    if failures:
        raise UserError("; ".join(failures))


def score_run(arm: Arm, seed: int, settings: Settings) -> None:
    run, result = settings.run(arm, seed), settings.result(arm, seed)
    score(run, arm.source, settings.place(arm), result, settings.fields(arm))


def is_finished(arm: Arm, seed: int, settings: Settings) -> bool:
    """Return whether a run has spent the budget of its arm."""
    run, flags = settings.run(arm, seed), flags_of(arm, settings.budget)
    if not (run / "recipe.json").exists() or not checkpoint.list_checkpoints(run / "checkpoints"):
        return False
    spent = checkpoint.counters_of(checkpoint.newest(run / "checkpoints"))
    by_step = "steps" in flags and spent.step >= flags["steps"]
    return by_step or ("minutes" in flags and spent.seconds >= 60 * flags["minutes"])
