"""How results are written into docs/results."""

from __future__ import annotations

import json
from pathlib import Path


def write(path: Path, value: object) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")
