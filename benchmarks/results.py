"""What every result in docs/results carries: how it was made, without the folders of the machine that made it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from unproject.training.run_directory import environment


def write(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")


def made_by(run: Path) -> dict[str, Any]:
    """How long a run has trained, and its command, commit, versions and machine."""
    lines = (run / "stats.jsonl").read_text(encoding="utf-8").splitlines()
    stored = environment() | json.loads((run / "environment.json").read_text(encoding="utf-8"))
    # Absolute paths by their names alone: the folders are one machine's, and say nothing to a reader.
    command = [Path(part).name if Path(part).is_absolute() else part for part in stored["command"]]
    return {"seconds": json.loads(lines[-1])["seconds"], "environment": stored | {"command": command}}
