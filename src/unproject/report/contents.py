"""Contents: what a run directory says of itself, read without trust: a damaged file is a remark, never an error."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any

from .._objects import import_name
from ..domains import BUILT_IN
from ..training.budget import number, progress_of
from ..training.checkpoint import newest_step, step_of
from ..training.environment import typed_command
from ..training.run_directory import VERDICT, read_recipe
from .log import Log

DAMAGED = "damaged or missing"
NEARLY = 0.9
_KINDS = {import_name(type(domain)): kind for kind, domain in BUILT_IN.items()}
"""What a built-in domain makes, by how recipe.json names it."""


@dataclass(frozen=True)
class Contents:
    """What the files of a run hold, as far as they can be read.

    Attributes:
        path: the run directory.
        recipe: of recipe.json: `recipe`, `arguments`, `resolved`.
        environment: of environment.json; empty if it is damaged.
        lines: the objects of stats.jsonl.
        verdict: of verdict.json; None if there is none on the newest checkpoint.
        previews: (step, picture file) over time.
        step: of the newest checkpoint; 0 if there is none.
        remarks: what is damaged or missing, a sentence each.
    """

    path: Path
    recipe: dict[str, Any]
    environment: dict[str, Any]
    lines: list[dict[str, Any]]
    verdict: dict[str, Any] | None
    previews: list[tuple[int, Path]]
    step: int
    remarks: list[str] = field(default_factory=list)

    @property
    def name(self) -> str:
        """Return the name of the run's folder."""
        return self.path.resolve().name or str(self.path)

    @cached_property
    def seconds(self) -> float:
        """Return how long it was trained, by its log."""
        return max((number(line.get("seconds")) or 0.0 for line in self.lines), default=0.0)

    @property
    def complete(self) -> bool:
        """Whether its budget is spent.

        Of minutes the log knows nearly all; a verdict then says so, unless the budget has grown since.
        """
        timed = number(self.recipe["resolved"].get("minutes")) is not None
        nearly = timed and (not self.lines or self.progress > NEARLY)
        return self.progress >= 1 or (self.verdict is not None and nearly)

    @cached_property
    def progress(self) -> float:
        """Return the part of recipe.json's budget that is spent."""
        # The last steps are not logged: the log is written every so many.
        logged = sorted(number(line.get("seconds")) or 0.0 for line in self.lines)[-2:]
        seconds = self.seconds + 2 * (logged[-1] - logged[0]) if logged else 0.0
        return progress_of(self.recipe["resolved"], self.step, seconds)

    @property
    def unfinished(self) -> str:
        """Say how far a run is that is not finished; else nothing."""
        if not self.step:
            return "There is no checkpoint yet: the run was stopped before its first one, or has just begun."
        if not self.complete:
            share = min(self.progress, 0.99)
            return (
                f"This run is not finished: {share:.0%} of its budget is spent, so there is no verdict. It was "
                "stopped, or is still training."
            )
        return ""

    @property
    def kind(self) -> str:
        """Return "volumes", "images" or "maps", what samples are.

        "" if a generator or domain of the user's own makes them, whose code is not imported.
        """
        resolved = self.recipe["resolved"]
        try:
            if resolved.get("domain") is not None:
                return _KINDS.get(resolved["domain"]["type"], "")
            module, _, name = str(resolved["generator"]["call"]).partition(":")
            return getattr(import_module(module), name).domain if module.startswith("unproject.") else ""
        except (KeyError, TypeError, ImportError, AttributeError):
            return ""

    @property
    def command(self) -> str | None:
        """Return the command that began the run, as it would be typed; None if it is not known."""
        return typed_command(self.environment)


def read_contents(path: Path, log: Log | None = None) -> Contents:
    """Read the files of a run.

    Args:
        log: its log, if it has been read before: what was read is not read again.

    Raises:
        UserError: if `path` is no run, or its recipe.json is damaged.
    """
    remarks: list[str] = []
    recipe = read_recipe(path)
    environment = _object(path / "environment.json", remarks) or {}
    verdict = _object(path / VERDICT, remarks) if (path / VERDICT).exists() else None
    if verdict is not None and not isinstance(verdict.get("word"), str):
        remarks.append(f"{VERDICT} is {DAMAGED}: `unproject evaluate` judges the run again.")
        verdict = None
    step = newest_step(path / "checkpoints")
    judged = number((verdict or {}).get("step"))
    if judged is not None and judged != step:  # training was killed before it had removed the verdict of before
        remarks.append(f"{VERDICT} is on step {judged:.0f}, not on {step}: `unproject evaluate` judges the run again.")
        verdict = None
    lines = _lines(log or Log(path / "stats.jsonl"), remarks)
    return Contents(path, recipe, environment, lines, verdict, _previews(path), step, remarks)


def _object(file: Path, remarks: list[str]) -> dict[str, Any] | None:
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        found = None
    if isinstance(found, dict):
        return found
    remarks.append(f"{file.name} is {DAMAGED}.")
    return None


def _lines(log: Log, remarks: list[str]) -> list[dict[str, Any]]:
    try:
        lines, damaged = log.read()
    except OSError:
        remarks.append(f"stats.jsonl is {DAMAGED}: there are no curves.")
        return []
    if damaged:
        remarks.append(f"{damaged} of {len(lines) + damaged} lines of stats.jsonl are damaged and left out.")
    return lines


def _previews(path: Path) -> list[tuple[int, Path]]:
    found = sorted((path / "samples").glob("step-*.png"))
    return [(step_of(file), file) for file in found if file.stem.removeprefix("step-").isdecimal()]
