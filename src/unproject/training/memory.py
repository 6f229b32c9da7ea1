"""Memory: what a process can have, and the refusal of what needs more."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path

import torch

from .._types import UserError

GIB = 2**30

_checked: ContextVar[bool] = ContextVar("checked", default=True)


@contextmanager
def unchecked() -> Iterator[None]:
    """Let `require_memory_to_train` refuse nothing: --force."""
    token = _checked.set(False)
    try:
        yield
    finally:
        _checked.reset(token)


def available_memory(device: torch.device) -> int | None:
    """Return the bytes that a process can have on a device; None where the system does not say.

    Processes that torchrun or `--processes` started on one machine have equal parts.
    """
    if device.type == "cuda":
        return torch.cuda.mem_get_info(device)[0]
    table = Path("/proc/meminfo")
    if not table.exists():
        return None
    lines = dict(line.split(":", 1) for line in table.read_text(encoding="ascii").splitlines())
    there = [1024 * int(lines["MemAvailable"].split()[0]), *_left_to_container(Path("/sys/fs/cgroup"))]
    return min(there) // int(os.environ.get("LOCAL_WORLD_SIZE", "1"))


def _left_to_container(groups: Path) -> list[int]:
    """Return the bytes that a control group, as of a container, leaves to its processes; nothing if it has no limit."""
    names = ("memory.max", "memory.current"), ("memory/memory.limit_in_bytes", "memory/memory.usage_in_bytes")
    for limit, used in names:
        if not (groups / limit).exists():
            continue
        most, taken = ((groups / name).read_text(encoding="ascii").strip() for name in (limit, used))
        stat = (groups / limit).with_name("memory.stat").read_text(encoding="ascii")
        cached = re.search(r"^(?:total_)?inactive_file (\d+)$", stat, re.MULTILINE)  # given up where memory is needed
        return [int(most) - int(taken) + int(cached[1] if cached else 0)] if most.isdigit() else []
    return []


def require_memory(need: int, what: str, instead: str, device: torch.device | None = None) -> None:
    """Refuse what takes more memory than there is.

    Args:
        need: bytes.
        what: takes them, with its verb.
        instead: what to do then.

    Raises:
        UserError: if less is available.
    """
    there = available_memory(device or torch.device("cpu"))
    if there is not None and need > there:
        raise UserError(f"{what} about {need / GIB:.1f} GB and {there / GIB:.1f} GB are available; {instead}")


def require_memory_to_train(need: int, what: str, instead: str, device: torch.device | None = None) -> None:
    """Refuse the same, but not under `unchecked`."""
    if _checked.get():
        require_memory(need, what, f"{instead}, or add --force", device)
