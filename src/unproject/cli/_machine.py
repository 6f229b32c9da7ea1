"""What verbs set on the machine before they compute, and who of several processes speaks."""

from __future__ import annotations

import os
import sys
from contextlib import contextmanager
from typing import TYPE_CHECKING

from .._types import printable

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from torch import Tensor

    from ..domains import Domain


M_MMAP_THRESHOLD, M_ARENA_MAX = -3, -8
"""Options of glibc's mallopt (malloc.h)."""
MAPPED_BYTES = 2**20


def return_memory() -> None:
    """Let freed memory go back to the system, for a program that runs for hours: by glibc's own choice much stays.

    Once a large block was freed, glibc takes blocks of its size from heaps, of which each thread has one, and returns
    only what is free at a heap's end. Here blocks of `MAPPED_BYTES` or more are mapped one by one, and heaps are two.
    Other systems' allocators are left as they are.
    """
    if sys.platform != "linux":
        return
    import ctypes

    set_option = getattr(ctypes.CDLL(None), "mallopt", None)  # musl has none
    if set_option is not None:
        set_option(M_MMAP_THRESHOLD, MAPPED_BYTES)
        set_option(M_ARENA_MAX, 2)


@contextmanager
def busy(doing: str) -> Iterator[None]:
    """Show what is being done, on a terminal, while it lasts."""
    if not sys.stderr.isatty() or not leads():
        yield
        return
    from rich.console import Console
    from rich.live import Live
    from rich.spinner import Spinner

    spinner = Spinner("dots", f"{doing} ...")
    with Live(spinner, console=Console(stderr=True), transient=True, redirect_stdout=False, redirect_stderr=False):
        yield


def leads() -> bool:
    """Whether this is the leading process, the only one that says and writes anything."""
    return os.environ.get("RANK", "0") == "0"


def say(line: str) -> None:
    """Print, from the leading process only if torchrun started several."""
    if leads():
        print(line)


def say_skipped(skipped: Sequence[tuple[str, str]], used: int) -> None:
    """Say which materials were skipped, once all went well: of a mistake there is one line and no more."""
    for name, why in skipped:
        print(printable(f"skipped {name}: {why}"), file=sys.stderr)
    if skipped:
        print(f"skipped {len(skipped)} of {len(skipped) + used} materials", file=sys.stderr)


def warn_if_empty(domain: Domain, x: Tensor) -> None:
    """Say in how many samples nothing is to be seen."""
    count = int(domain.empty(x).sum())
    if leads() and count:
        none = f"all {len(x)} samples are empty (nothing above 0.5); train longer, or see `unproject evaluate`"
        some = f"{count} of {len(x)} samples empty (nothing above 0.5); another --seed draws others"
        print(f"warning: {none if count == len(x) else some}", file=sys.stderr)
