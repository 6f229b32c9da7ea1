"""Which version of the project a record was made at."""

from __future__ import annotations

import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def commit(*paths: str) -> str:
    """Return the commit of the working tree, which ends in + if src, tools or `paths` were changed since."""
    git = ["git", "-C", str(ROOT)]
    name = subprocess.run([*git, "rev-parse", "--short=7", "HEAD"], capture_output=True, text=True).stdout.strip()
    changed = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", "src", "tools/*.py", *paths]).returncode
    return f"{name or 'unknown'}{'+' if changed else ''}"
