"""Worker: one thread that computes, and a queue before it that is soon full."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from .answers import Busy

T = TypeVar("T")


class Worker:
    """Calls functions one after another in a thread of its own.

    Args:
        waiting: calls that may wait; those that were cancelled do not count.

    Attributes:
        busy: whether one is being made.

    Examples:
        >>> Worker(waiting=2).submit(lambda: 1 + 1).result()
        2
    """

    def __init__(self, waiting: int) -> None:
        self.busy, self._most = False, waiting
        self._calls: deque[tuple[Callable[[], object], Future[Any]]] = deque()
        self._there = threading.Condition()
        threading.Thread(target=self._work, daemon=True).start()

    def submit(self, call: Callable[[], T]) -> Future[T]:
        """Return what will hold the result.

        Raises:
            Busy: if too many calls wait.
        """
        future: Future[T] = Future()
        with self._there:
            self._calls = deque(one for one in self._calls if not one[1].cancelled())
            if len(self._calls) >= self._most:
                raise Busy("too much is being computed; wait a moment")
            self._calls.append((call, future))
            self._there.notify()
        return future

    def _work(self) -> None:
        while True:
            with self._there:
                self._there.wait_for(lambda: self._calls)
                call, future = self._calls.popleft()
            if not future.set_running_or_notify_cancel():
                continue
            self.busy = True
            try:
                future.set_result(call())
            except BaseException as error:  # whoever waits for the result has it
                future.set_exception(error)
            self.busy = False
