"""What verbs set on the machine before they compute, and who of several processes speaks."""

from __future__ import annotations

import os
import sys
from typing import TYPE_CHECKING

from .._types import UserError

if TYPE_CHECKING:
    from torch import Tensor

    from ..domains import Domain


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


def warn_if_empty(domain: Domain, x: Tensor) -> None:
    """Say so if nothing is to be seen in any sample."""
    if os.environ.get("RANK", "0") == "0" and domain.is_empty(x):
        print(
            f"warning: all {len(x)} samples are empty (nothing above 0.5); train longer, or see `unproject evaluate`",
            file=sys.stderr,
        )
