"""`--processes N`: a verb in N processes of this machine, by the agent of torchrun; of a failure there is one line.

On several machines start `torchrun` itself, which gives a longer report. The agent ends all processes when one fails,
and they save and leave when the agent is gone.
"""

from __future__ import annotations

import logging
import os
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from .._cores import cores
from .._parent import PARENT
from .._types import UserError
from ._machine import leads

MAX_PROCESSES = 1024
FLAG = "--processes"
PATIENCE = 3.0
"""Seconds that a process waits before it speaks: another one that has the same to say, or the cause, is first."""
LOST = ("gloo", "NCCL", "Connection closed by peer", "Connection reset by peer", "Broken pipe")
"""What torch says in a process that has lost another one."""


def in_processes(verb: str, argv: Sequence[str], call: Callable[[], Any]) -> Callable[[], Any]:
    """Return `call`, or what starts the verb in so many processes as `argv` asks for, without that flag."""
    count, rest = _count(argv)
    if count is None or _is_one_of_several():
        return call
    if not 1 <= count <= MAX_PROCESSES:
        raise UserError(f"{FLAG} {count}: give 1 to {MAX_PROCESSES}, one for each GPU, or for a part of the processors")
    return call if count == 1 else lambda: launch([verb, *rest], count)


def _count(argv: Sequence[str]) -> tuple[int | None, list[str]]:
    """Return the number of processes and the other words; `argv` was read before, so that it is well formed."""
    given, words, rest = "", iter(argv), []
    for word in words:
        name, equals, value = word.partition("=")
        if name == FLAG:
            given = value if equals else next(words)  # of several the last counts
        else:
            rest.append(word)
    return (int(given) if given else None), rest


def launch(words: Sequence[str], count: int) -> int:
    """Run `unproject WORDS` in so many processes; return the exit status, of the process that failed first.

    By Ctrl-C or SIGTERM they save and leave, as one process does, whose status then is 0.
    """
    from torch.distributed.elastic.multiprocessing import DefaultLogsSpecs, SignalException
    from torch.distributed.elastic.multiprocessing.errors import ChildFailedError
    from torch.distributed.launcher.api import LaunchConfig, elastic_launch

    # Threads of several processes would wait for one another's processors.
    os.environ.setdefault("OMP_NUM_THREADS", str(max(cores() // count, 1)))
    os.environ[PARENT] = str(os.getpid())  # they stop when this process is killed, which has the terminal
    logging.disable(logging.CRITICAL)  # the agent's own report of a failure
    config = LaunchConfig(
        min_nodes=1,
        max_nodes=1,
        nproc_per_node=count,
        run_id="unproject",
        rdzv_backend="c10d",
        rdzv_endpoint="localhost:0",
        max_restarts=0,
        monitor_interval=0.1,
        logs_specs=DefaultLogsSpecs(log_dir=os.devnull),  # the agent would leave a folder behind
    )
    try:
        elastic_launch(config, sys.executable)("-m", "unproject", *words)
    except ChildFailedError as error:
        rank, failure = error.get_first_failure()
        return _failed(rank, count, failure.exitcode)
    except SignalException:  # once the agent has handed the signal on, and waited for them
        return 0
    finally:
        logging.disable(logging.NOTSET)
        os.environ.pop(PARENT)
    return 0


def _failed(rank: int, count: int, status: int) -> int:
    """Return the status of all; say what became of a process that could not speak."""
    if status == 2:
        return status
    how = f"was ended by signal {-status}" if status < 0 else f"failed with status {status}"
    print(f"unproject: process {rank} of {count} {how}; resume goes on from the last checkpoint", file=sys.stderr)
    return status if status > 0 else 1


def lost_another(error: BaseException) -> bool:
    """Whether this process of several cannot go on since another one has ended."""
    return _is_one_of_several() and any(words in str(error) for words in LOST)


def let_others_speak() -> None:
    """Wait, in all processes but the first: whoever fails first ends the others, so that one line is printed."""
    if _is_one_of_several() and not leads():
        time.sleep(PATIENCE)


def _is_one_of_several() -> bool:
    return int(os.environ.get("WORLD_SIZE", "1")) > 1
