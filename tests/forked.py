"""Python processes of tests that are forked: they have imported everything, which takes five seconds each time."""

from __future__ import annotations

import atexit
import os
import runpy
import signal
import subprocess
import sys
import threading
import traceback
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import torch


class ForkedPython(subprocess.Popen[Any]):
    """`subprocess.Popen`, but where this Python is started, a copy of this process runs what was asked for.

    Standard streams, folder, environment, session and exit status are those of a new process; SIGINT and SIGTERM do
    what they do by default. The copy sees what tests have set by `monkeypatch`. Other programs are started as ever.
    """

    def __init__(self, args: Any, *others: Any, **given: Any) -> None:
        words = [str(args)] if isinstance(args, str | bytes | os.PathLike) else [str(word) for word in args]
        if words[0] == sys.executable and not given.get("shell"):
            given["preexec_fn"] = partial(_act, words[1:], given.get("env"))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # threads of this process, which the copy does not use
            super().__init__(args, *others, **given)


def _act(words: Sequence[str], environment: Mapping[str, str] | None) -> None:
    """What the copy does in place of starting a program: it never returns."""
    status = 1
    try:
        _forget(environment)
        status = _run(words)
    except BaseException:
        traceback.print_exc()
    finally:
        with suppress(BaseException):
            threading._shutdown()  # type: ignore[attr-defined]  # waits for threads, as at the end of any Python
            atexit._run_exitfuncs()
        for stream in (sys.stdout, sys.stderr):
            with suppress(OSError):
                stream.flush()
        os._exit(status)


def _forget(environment: Mapping[str, str] | None) -> None:
    """Undo what a new process would not have."""
    nothing = os.open(os.devnull, os.O_RDWR)
    for name in os.listdir("/proc/self/fd"):
        if int(name) > 2 and int(name) != nothing:  # not closed: objects that are no more would close another file's
            with suppress(OSError):
                os.dup2(nothing, int(name), inheritable=False)
    if environment is not None:
        os.environ.clear()
        os.environ.update(environment)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    atexit._clear()
    warnings.simplefilter("ignore")
    sys.stdin = os.fdopen(0, closefd=False)
    sys.stdout, sys.stderr = (os.fdopen(number, "w", buffering=1, closefd=False) for number in (1, 2))
    torch.set_num_threads(1)  # threads that this process has begun do not survive a fork


def _run(words: Sequence[str]) -> int:
    """Run the words that follow `python`; return the exit status."""
    words = [word for word in words if word != "-u"]
    try:
        if words[0] == "-m":
            sys.argv = ["", *words[2:]]
            runpy.run_module(words[1], run_name="__main__", alter_sys=True)
        elif words[0] == "-c":
            sys.argv = ["-c", *words[2:]]
            exec(compile(words[1], "<string>", "exec"), {"__name__": "__main__"})
        else:
            sys.argv = list(words)
            sys.path.insert(0, str(Path(words[0]).resolve().parent))
            runpy.run_path(words[0], run_name="__main__")
    except SystemExit as end:
        if end.code is None or isinstance(end.code, int):
            return end.code or 0
        print(end.code, file=sys.stderr)
        return 1
    return 0
