"""Warnings on the command line: ours, a line each, once it is sure that no mistake follows; no library's."""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from .._types import printable

_held: list[str] = []


@contextmanager
def held() -> Iterator[None]:
    """Keep warnings until the block ends well or `release` is called; drop them after a mistake, which is one line."""
    _held.clear()
    logging.lastResort = logging.NullHandler()  # what libraries log goes to stderr otherwise
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.filterwarnings("always", category=UserWarning, module=r"unproject\b")
        warnings.showwarning = lambda message, *_, **__: _held.append(printable(message))
        yield
    release()


def release() -> None:
    """Print the warnings so far, each once: a folder may be read twice."""
    for line in dict.fromkeys(_held):
        print(f"warning: {line}", file=sys.stderr)
    _held.clear()
