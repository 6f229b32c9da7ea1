"""Store the result of an arm: its scores, how it was trained, and a picture. Nothing is computed twice."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from .._types import UserError
from ..metrics import Score
from ..training import checkpoint
from ..training.run_directory import environment, write_json


@dataclass(frozen=True)
class Result:
    """The result of one arm and seed: ARM-SEED.json and ARM-SEED.webp, and ARM-SEED-views.webp if views are predicted.

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
        """The picture of training images grouped by predicted view."""
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
        try:
            content = json.loads(self.file.read_text(encoding="utf-8"))
            if not all(math.isfinite(score["value"]) for score in content["scores"].values()):
                raise ValueError("a score is not finite")
            for name in ("steps", "seconds", "environment") if "steps" in content else ():
                content[name]
            return content
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise UserError(f"{self.file}: damaged ({error}); remove it, and its arm is scored again") from error

    def values(self) -> dict[str, float]:
        """Return score → value."""
        return {name: float(score["value"]) for name, score in self.read()["scores"].items()}


def as_json(value: Mapping[str, Any]) -> dict[str, Any]:
    """Return the value as it is after writing and reading it: tuples become lists."""
    return json.loads(json.dumps(value))


def provenance(run: Path) -> dict[str, Any]:
    """Return a run's seconds, command, commit, versions and machine; paths are shortened to their last part."""
    stored = environment() | json.loads((run / "environment.json").read_text(encoding="utf-8"))
    command = [Path(part).name if Path(part).is_absolute() else part for part in stored["command"]]
    return {"seconds": seconds_of(run), "environment": stored | {"command": command}}


def seconds_of(run: Path) -> float:
    """Return the training time of a run at its newest checkpoint."""
    return checkpoint.load(checkpoint.newest(run / "checkpoints"), "counters/")["counters/seconds"].item()
