"""Worker: one thread that computes, and a queue before it that is soon full."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable
from concurrent.futures import Future
from typing import TypeVar

from .answers import Busy

T = TypeVar("T")


class Worker:
    """Calls functions one after another in a thread of its own.

    Args:
        waiting: calls that may wait.

    Attributes:
        busy: whether one is being made.

    Examples:
        >>> Worker(waiting=2).submit(lambda: 1 + 1).result()
        2
    """

    def __init__(self, waiting: int) -> None:
        self.busy = False
        self._calls: queue.Queue[tuple[Callable[[], object], Future[object]]] = queue.Queue(waiting)
        threading.Thread(target=self._work, daemon=True).start()

    def submit(self, call: Callable[[], T]) -> Future[T]:
        """Return what will hold the result.

        Raises:
            Busy: if too many calls wait.
        """
        future: Future[T] = Future()
        try:
            self._calls.put_nowait((call, future))  # pyright: ignore[reportArgumentType]
        except queue.Full:
            raise Busy("too much is being computed; wait a moment") from None
        return future

    def _work(self) -> None:
        while True:
            call, future = self._calls.get()
            if not future.set_running_or_notify_cancel():
                continue
            self.busy = True
            try:
                future.set_result(call())
            except BaseException as error:  # whoever waits for the result has it
                future.set_exception(error)
            self.busy = False
