"""What verbs set on the machine before they compute, and who of several processes speaks."""

from __future__ import annotations

import os

from .._types import UserError


def use_threads(threads: int | None) -> None:
    """Let torch use this many threads; None leaves its own choice."""
    if threads is None:
        return
    if threads < 1:
        raise UserError(f"--threads {threads}: give at least 1")
    import torch

    torch.set_num_threads(threads)


def say(line: str) -> None:
    """Print, from the leading process only if torchrun started several."""
    if os.environ.get("RANK", "0") == "0":
        print(line)
