"""Two processes joined as by torchrun, but forked from one that has imported torch, which takes seconds each time."""

from __future__ import annotations

import os
import signal
import socket
import sys
import traceback
from collections.abc import Callable

import torch.distributed as dist


def in_two(act: Callable[[], object]) -> None:
    """Run `act` in two processes; when one fails, end the other and exit with status 1."""
    with socket.socket() as kept:  # until the end, so that no other process is given its port before these listen on it
        kept.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        kept.bind(("localhost", 0))
        os.environ.update(WORLD_SIZE="2", MASTER_ADDR="localhost", MASTER_PORT=str(kept.getsockname()[1]))
        running = {_forked(rank, act) for rank in (0, 1)}
        while running:
            child, status = os.wait()
            running.discard(child)
            if status:
                for other in running:
                    os.kill(other, signal.SIGKILL)
                sys.exit(1)


def _forked(rank: int, act: Callable[[], object]) -> int:
    child = os.fork()
    if child:
        return child
    os.environ["RANK"] = os.environ["LOCAL_RANK"] = str(rank)
    status = 1
    try:
        act()
        dist.barrier()  # the first one holds what the other still asks
        status = 0
    except BaseException:
        traceback.print_exc()
    os._exit(status)
