"""Distribution over processes and devices: one process by itself, or many started by `torchrun`.

Every process runs the same loop on its own slice of each batch; after every backward pass the gradients are
averaged. They are averaged by hand, not by `DistributedDataParallel`, which supports neither double backward
passes (gradient penalties) nor several forward passes a step.
"""

from __future__ import annotations

import atexit
import os
from collections.abc import Iterable, Sequence

import torch
import torch.distributed as dist
from torch import Tensor, nn

from .._random import part_at
from .._types import UserError


def _number(variable: str, default: int) -> int:
    """The value of an environment variable."""
    given = os.environ.get(variable, str(default))
    if not given.isdecimal():
        raise UserError(f"{variable}={given!r}: is no number of processes; start them with --processes or torchrun")
    return int(given)


def device_of(name: str) -> torch.device:
    """Return the device of this process, of its name: "auto", "cpu" or "cuda".

    Raises:
        UserError: for another name, or a CUDA device that is not there.
    """
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    if name == "cuda" and not torch.cuda.is_available():
        raise UserError("device 'cuda': no CUDA device is there; use cpu")
    if name not in ("cpu", "cuda"):
        raise UserError(f"device {name!r}: choose auto, cpu or cuda")
    device = torch.device(f"cuda:{os.environ.get('LOCAL_RANK', '0')}" if name == "cuda" else "cpu")
    if device.type == "cuda" and (device.index or 0) >= torch.cuda.device_count():
        raise UserError(f"{device}: {torch.cuda.device_count()} CUDA devices are there; start as many processes")
    return device


class Distribution:
    """This process among `world` ones, and its device ("auto", "cpu" or "cuda").

    The environment variables of `torchrun` say how many processes there are and where they meet.
    """

    def __init__(self, device: str = "auto") -> None:
        self.world, self.rank = _number("WORLD_SIZE", 1), _number("RANK", 0)
        self.device = device_of(device)
        if self.device.type == "cuda":
            torch.backends.cudnn.deterministic = True  # a run repeats bit for bit
        if self.world > 1 and not dist.is_initialized():
            missing = [name for name in ("RANK", "MASTER_ADDR", "MASTER_PORT") if name not in os.environ]
            if missing:
                raise UserError(
                    f"WORLD_SIZE={self.world} is set, but not {', '.join(missing)}; start processes with --processes "
                    "or torchrun, or unset WORLD_SIZE"
                )
            _join(self.device)

    @property
    def leads(self) -> bool:
        """Whether this is the process that writes files."""
        return self.rank == 0

    def own(self, whole: Tensor) -> Tensor:
        """Return this process's part of what belongs to the batches of all."""
        return whole.chunk(self.world)[self.rank]

    def part(self, seed: int, step: int, stream: str, rows: Tensor | None = None) -> torch.Generator:
        """Return the source of this process's draws (`_random.BatchShard`); `rows` are those of the batches of all."""
        return part_at(seed, step, stream, self.rank, self.world, rows)

    def average_gradients(self, module: nn.Module) -> None:
        """Replace each gradient by its mean over the processes."""
        if self.world == 1:
            return
        gradients = [p.grad for p in module.parameters() if p.grad is not None]
        if not gradients:
            return
        flat = self._mean(torch.cat([g.flatten() for g in gradients]))
        for gradient, part in zip(gradients, flat.split([g.numel() for g in gradients]), strict=True):
            gradient.copy_(part.view_as(gradient))

    def average(self, value: float) -> float:
        """Return the mean of a number over the processes, in double precision."""
        if self.world == 1:
            return value
        return float(self._mean(torch.tensor(value, dtype=torch.float64, device=self.device)))

    def mean(self, values: Tensor) -> Tensor:
        """Return the mean of a tensor over the processes."""
        return values if self.world == 1 else self._mean(values.clone())

    def _mean(self, values: Tensor) -> Tensor:
        # A sum and a division: gloo has no mean.
        dist.all_reduce(values)
        return values.div_(self.world)

    def copy_from_leader(self, tensors: Iterable[Tensor]) -> None:
        """Overwrite each tensor by the leading process's."""
        if self.world == 1:
            return
        for tensor in tensors:
            values = tensor.detach().contiguous()
            values = values.int() if values.dtype == torch.int16 else values  # which gloo does not know
            dist.broadcast(values, src=0)
            tensor.data.copy_(values)

    def joined(self, part: Tensor, lengths: Sequence[int]) -> Tensor:
        """Return the parts of all processes, (lengths[rank], ...) each, one after another."""
        if self.world == 1:
            return part
        parts = part.new_zeros(len(lengths), max(lengths), *part.shape[1:])
        parts[self.rank, : len(part)] = part
        dist.all_reduce(parts)  # a sum with zeros: parts may be of different lengths, which gloo does not gather
        return torch.cat([found[:length] for found, length in zip(parts, lengths, strict=True)])

    def agree(self, flag: bool) -> bool:
        """Return whether the flag is set in any process."""
        return flag if self.world == 1 else self.average(float(flag)) > 0

    def barrier(self) -> None:
        """Wait until every process is here."""
        if self.world > 1:
            dist.barrier()

    def close(self) -> None:
        """Leave a run together: a process that exits first aborts the others.

        The group stays until the process ends: one that is formed anew may find the old addresses of the others in the
        store, and then waits for them for ever.
        """
        self.barrier()


def _join(device: torch.device) -> None:
    atexit.register(_leave)
    if device.type == "cpu":
        dist.init_process_group("gloo")
        return
    torch.cuda.set_device(device)
    dist.init_process_group("cpu:gloo,cuda:nccl", device_id=device)


def _leave() -> None:
    """Leave the group when the process ends, unless it was not joined or somebody else has left it."""
    if dist.is_initialized():
        dist.destroy_process_group()
