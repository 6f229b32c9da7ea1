"""Environment: versions, machine and command of a run."""

from __future__ import annotations

import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping
from datetime import datetime, timezone
from importlib import metadata
from pathlib import Path
from typing import Any

import torch


def environment() -> dict[str, Any]:
    """Return versions, machine and command: what is needed to assess or repeat the run."""
    packages = ("unproject", "torch", "numpy", "safetensors")
    return {
        "command": [Path(sys.argv[0]).name, *sys.argv[1:]],
        "started": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "commit": _commit(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processor": _processor(),
        "cpus": os.cpu_count(),
        "threads": torch.get_num_threads(),
        "cuda": torch.cuda.get_device_name() if torch.cuda.is_available() else None,
        "packages": {name: _version(name) for name in packages},
    }


def typed_command(found: Mapping[str, Any]) -> str | None:
    """Return the command that began a run, as it would be typed, of what `environment` returned; None if not known.

    Examples:
        >>> typed_command({"command": ["__main__.py", "train", "shapes", "--data", "my masks"]})
        "unproject train shapes --data 'my masks'"
    """
    words = found.get("command")
    if not isinstance(words, list) or not words:
        return None
    first = "unproject" if words[0] in ("__main__.py", "unproject") else str(words[0])
    return " ".join([first, *(shlex.quote(str(word)) for word in words[1:])])


def _processor() -> str:
    """Its name; Linux tells it here alone."""
    table = Path("/proc/cpuinfo")
    told = table.read_text(encoding="utf-8") if table.exists() else ""
    name = re.search(r"^model name\s*: (.+)$", told, re.MULTILINE)
    return name[1] if name else platform.processor() or platform.machine()


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _commit(root: Path = Path(__file__).parents[3]) -> str | None:
    """The package's own, in a checkout: an installed package may lie in the repository of somebody's project."""
    git = shutil.which("git")
    if git is None or not (root / ".git").exists():
        return None
    words = [git, "-C", str(root), "describe", "--always", "--dirty"]
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip() or None
