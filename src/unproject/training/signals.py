"""Signals: Ctrl-C, SIGTERM or SIGHUP asks a run to save and leave; only a second Ctrl-C does not wait for it.

Whoever ends a job sends SIGTERM to each of its processes, and torchrun's agent hands on what it is sent, so that a
process hears it several times while it saves.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

ASKING = [signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])]


@contextmanager
def stop_request() -> Iterator[Callable[[], bool]]:
    """Yield a function that says whether a stop was asked for; a second Ctrl-C raises KeyboardInterrupt."""
    asked: set[int] = set()

    def ask(number: int, frame: FrameType | None) -> None:
        if number == signal.SIGINT and number in asked:
            raise KeyboardInterrupt
        asked.add(number)

    try:
        heard = [number for number in ASKING if number is signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN]
        previous = {number: signal.signal(number, ask) for number in heard}  # nohup ignores SIGHUP: the run goes on
    except ValueError:  # not in the main thread, where signals cannot be caught
        previous = {}
    try:
        yield lambda: bool(asked)
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
