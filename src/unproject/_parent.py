"""A process that another one started stops when that one is gone, even if it was killed."""

from __future__ import annotations

import os
import signal
import threading
import time

PARENT = "UNPROJECT_PARENT"
"""Environment variable: the process without which this one is to stop."""


def stop_with_parent() -> None:
    """Let this process stop, as by SIGTERM, when the one that `PARENT` names is gone."""
    parent = os.environ.get(PARENT, "")
    if parent.isdecimal():
        threading.Thread(target=_stop_after, args=(int(parent),), daemon=True).start()


def _stop_after(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(0.5)
    os.kill(os.getpid(), signal.SIGTERM)
