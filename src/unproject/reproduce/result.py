"""Store the result of an arm: its scores, how it was trained, and a picture. Nothing is computed twice."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .._files import read_json, understood
from .._types import UserError
from ..metrics import Score
from ..training import checkpoint
from ..training.environment import environment
from ..training.run_directory import write_json


@dataclass(frozen=True)
class Result:
    """The result of one arm and seed: ARM-SEED.json, ARM-SEED.webp, and ARM-SEED-views.webp if views are predicted.

    Attributes:
        folder: of the results.
        arm: name of the arm, or of true samples.
        seed: of the training.
    """

    folder: Path
    arm: str
    seed: int

    @property
    def file(self) -> Path:
        return self.folder / f"{self.arm}-{self.seed}.json"

    @property
    def picture(self) -> Path:
        return self.folder / f"{self.arm}-{self.seed}.webp"

    @property
    def views(self) -> Path:
        """The picture of training images grouped by predicted view; of real collections there is none."""
        return self.folder / f"{self.arm}-{self.seed}-views.webp"

    @property
    def exists(self) -> bool:
        return self.file.exists()

    def write(self, scores: Mapping[str, Score], fields: Mapping[str, Any]) -> None:
        """Write the scores, and further fields that say how they came about."""
        content = {"arm": self.arm, "seed": self.seed} | dict(fields)
        write_json(self.file, content | {"scores": {name: asdict(score) for name, score in scores.items()}})

    def check(self, fields: Mapping[str, Any]) -> None:
        """Raise UserError unless the stored fields have these values."""
        content = self.read()
        for name, value in as_json(fields).items():
            if content.get(name) != value:
                raise UserError(
                    f"{self.file}: was made with {name} {content.get(name)}, the arm has {value}; remove that file, or "
                    "give another --out"
                )

    def read(self) -> dict[str, Any]:
        """Return the content of the file.

        Raises:
            UserError: the file is damaged.
        """
        content = read_json(self.file, AGAIN)
        with understood(self.file, AGAIN):
            for score in content["scores"].values():
                if not math.isfinite(score["value"]):
                    raise ValueError("a score is not finite")
                _check_kinds(score, {"value": (int, float), "protocol": str, "n": int, "seed": int})
            if {"recipe", "steps", "environment"} & content.keys():  # else true samples, which nothing trained
                _check_kinds(content, {"steps": int, "seconds": (int, float), "environment": dict})
                if not math.isfinite(content["seconds"]):
                    raise ValueError("the seconds are not finite")
                _check_kinds(content["environment"], MADE)
                _check_kinds(dict(enumerate(content["environment"]["command"])), {}, str)
            return content

    def values(self) -> dict[str, float]:
        """Return score → value."""
        return {name: float(score["value"]) for name, score in self.read()["scores"].items()}


MADE: dict[str, Any] = {
    "command": list, "started": str, "commit": (str, type(None)), "processor": str, "cpus": (int, type(None)),
    "threads": int, "cuda": (str, type(None)),
}  # fmt: skip
"""Types of what a report says of how an arm was trained."""
AGAIN = "remove it, and its arm is scored again"


def _check_kinds(content: Mapping[Any, Any], kinds: Mapping[str, Any], of_all: Any = object) -> None:
    """Raise an error unless values are of these types, and all of one type, and can be written in a report."""
    for name, kind in kinds.items():
        if not isinstance(content[name], kind):
            raise TypeError(f"{name} is {content[name]!r}")
    if not all(isinstance(value, of_all) for value in content.values()):
        raise TypeError(f"one of {list(content.values())} is of another type")
    for value in content.values():
        str(value).encode()  # JSON may hold halves of characters, which no file takes


def as_json(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return the value as it is after writing and reading it: tuples become lists."""
    return json.loads(json.dumps(value))


def provenance(run: Path) -> dict[str, Any]:
    """Return a run's seconds, command, commit, versions and machine; paths are shortened to their last part."""
    file = run / "environment.json"
    stored = environment() | read_json(file, "restore it from a copy, or remove the run and train its arm again")
    _check_kinds(dict(enumerate(stored["command"])), {}, str)
    command = [Path(part).name if Path(part).is_absolute() else part for part in stored["command"]]
    return {"seconds": seconds_of(run), "environment": stored | {"command": command}}


def seconds_of(run: Path) -> float:
    """Return the training time of a run at its newest checkpoint."""
    return checkpoint.counters_of(checkpoint.newest(run / "checkpoints")).seconds
