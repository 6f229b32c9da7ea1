"""What is kept of an arm when it is finished: its scores, how it was made, and a picture. Nothing is computed twice."""

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
class Kept:
    """Of one arm and seed: ARM-SEED.json and ARM-SEED.webp in a folder; ARM-SEED-views.webp if views were predicted."""

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
        """Training images grouped by the view they were assigned."""
        return self.folder / f"{self.arm}-{self.seed}-views.webp"

    @property
    def exists(self) -> bool:
        return self.file.exists()

    def write(self, scores: Mapping[str, Score], about: Mapping[str, Any]) -> None:
        content = {"arm": self.arm, "seed": self.seed} | dict(about)
        write_json(self.file, content | {"scores": {name: asdict(score) for name, score in scores.items()}})

    def check(self, about: Mapping[str, Any]) -> None:
        """Raise UserError unless the result is of this recipe and these flags."""
        content = self.read()
        for name, value in as_json(about).items():
            if content.get(name) != value:
                raise UserError(
                    f"{self.file}: was made with {name} {content.get(name)}, the arm has {value}; remove that file, or "
                    "give another --out"
                )

    def read(self) -> dict[str, Any]:
        """Raises UserError if the file is damaged."""
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
        return {name: float(score["value"]) for name, score in self.read()["scores"].items()}


def as_json(value: Mapping[str, Any]) -> dict[str, Any]:
    """As it is read again: tuples are lists."""
    return json.loads(json.dumps(value))


def made_by(run: Path) -> dict[str, Any]:
    """How long a run has trained, its command, commit, versions and machine; no folders of that machine."""
    stored = environment() | json.loads((run / "environment.json").read_text(encoding="utf-8"))
    command = [Path(part).name if Path(part).is_absolute() else part for part in stored["command"]]
    return {"seconds": seconds_of(run), "environment": stored | {"command": command}}


def seconds_of(run: Path) -> float:
    """How long a run has trained, by its newest checkpoint."""
    return checkpoint.load(checkpoint.newest(run / "checkpoints"), "counters/")["counters/seconds"].item()
