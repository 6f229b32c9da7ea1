"""Distribution over processes and devices: one process by itself, or many started by `torchrun`.

Every process runs the same loop on its own slice of each batch; after every backward pass the gradients are
averaged. Averaging by hand rather than through a wrapper keeps double backward passes (gradient penalties)
and several forward passes a step out of the wrapper's way.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from functools import cached_property
from typing import Any

import torch
from torch import Tensor, nn

from .._types import UserError


class Distribution:
    """This process among `world` ones, and its device ("auto", "cpu" or "cuda")."""

    def __init__(self, device: str = "auto") -> None:
        self.world = int(os.environ.get("WORLD_SIZE", "1"))
        self.rank = int(os.environ.get("RANK", "0"))
        if device == "auto":
            device = "cuda" if torch.cuda.is_available() else "cpu"
        if device == "cuda" and not torch.cuda.is_available():
            raise UserError("device 'cuda': no CUDA device is there; use --device cpu")
        if device not in ("cpu", "cuda"):
            raise UserError(f"device {device!r}: choose auto, cpu or cuda")
        self.device = torch.device(f"cuda:{os.environ.get('LOCAL_RANK', '0')}" if device == "cuda" else "cpu")
        if self.world > 1:
            self._fabric.launch()

    @cached_property
    def _fabric(self) -> Any:
        # Imported only where there are several processes: it takes longer to import than torch.
        from lightning_fabric import Fabric

        local = int(os.environ.get("LOCAL_WORLD_SIZE", str(self.world)))
        return Fabric(accelerator=self.device.type, devices=local, num_nodes=self.world // local, strategy="ddp")

    @property
    def leads(self) -> bool:
        """Whether this is the process that writes files."""
        return self.rank == 0

    def average_gradients(self, module: nn.Module) -> None:
        """Replace each gradient by its mean over the processes."""
        if self.world == 1:
            return
        gradients = [p.grad for p in module.parameters() if p.grad is not None]
        flat = self._fabric.all_reduce(torch.cat([g.flatten() for g in gradients]), reduce_op="mean")
        for gradient, part in zip(gradients, flat.split([g.numel() for g in gradients]), strict=True):
            gradient.copy_(part.view_as(gradient))

    def average(self, value: float) -> float:
        """The mean of a number over the processes."""
        if self.world == 1:
            return value
        return float(self._fabric.all_reduce(torch.tensor(value, device=self.device), reduce_op="mean"))

    def copy_from_leader(self, tensors: Iterable[Tensor]) -> None:
        """Overwrite each tensor by the leading process's."""
        if self.world > 1:
            for tensor in tensors:
                tensor.data.copy_(self._fabric.broadcast(tensor, src=0))

    def agree(self, flag: bool) -> bool:
        """Whether any process says so."""
        return flag if self.world == 1 else self.average(float(flag)) > 0

    def barrier(self) -> None:
        if self.world > 1:
            self._fabric.barrier()

    def close(self) -> None:
        """Leave together: a process that exits first aborts the others."""
        if self.world > 1 and torch.distributed.is_initialized():
            torch.distributed.barrier()
            torch.distributed.destroy_process_group()
