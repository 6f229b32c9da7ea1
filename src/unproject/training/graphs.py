"""Graphs: passes of networks and projections on a GPU, recorded once and replayed.

At the size of these networks a kernel runs for some microseconds, and the processor takes several times as long to
start it. A CUDA graph starts all of a pass at once: the same kernels in the same order, with the same result.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import torch
from torch import Tensor, nn

from ..projections.base import Projection

ENABLED = True
"""Whether passes are replayed where they can be."""
TRIALS = 3
"""Passes before the one that is recorded, in which libraries choose and load their kernels."""


def can_compile(device: torch.device) -> bool:
    """Whether torch can compile for a device: on processors it needs a compiler."""
    return device.type == "cuda" or any(map(shutil.which, (os.environ.get("CXX", "g++"), "clang++")))


class Graphs:
    """Calls functions that are `replayable`, on a GPU, by replaying what their first call did.

    What is replayable says so: its result depends on its inputs, parameters and buffers alone, in the same operations
    whatever their values, of which none waits for the processor. A result, and its gradients, are overwritten by the
    next call from the same place with inputs of the same shapes: a step uses each before that.

    Args:
        enabled: whether anything is replayed; not where passes wait for other processes.
    """

    def __init__(self, enabled: bool = True) -> None:
        self.enabled = enabled
        self._passes: dict[Hashable, Passes] = {}

    def __call__(self, module: nn.Module, *inputs: Tensor) -> Tensor:
        """Return `module(*inputs)`."""
        return self.replayed("module", module, inputs, module) if replayable(module) else module(*inputs)

    def projecting(self, place: int) -> Callable[..., Tensor]:
        """Return what calls a projection, `call(projection, x, **latents)`, at one of several places, for one step.

        Only its first call is replayed: an assignment may project several times, and needs all of the results.
        """
        fresh = True

        def call(projection: Projection, x: Tensor, **latents: Tensor) -> Tensor:
            nonlocal fresh
            if not fresh or not replayable(projection):
                return projection(x, **latents)
            fresh, names = False, tuple(latents)

            def function(x: Tensor, *values: Tensor) -> Tensor:
                return projection(x, **dict(zip(names, values, strict=True)))

            return self.replayed((place, names), function, (x, *latents.values()))

        return call

    def replayed(
        self,
        place: Hashable,
        function: Callable[..., Tensor],
        inputs: tuple[Tensor, ...],
        module: nn.Module | None = None,
    ) -> Tensor:
        """Return `function(*inputs)`, which is replayable, and uses the parameters and buffers of a module."""
        if not (ENABLED and self.enabled and inputs[0].is_cuda and torch.cuda.is_available()):
            return function(*inputs)
        parameters = [] if module is None else [p for p in module.parameters() if p.requires_grad]
        kind = module, module is not None and module.training, bool(parameters), _cast()
        key = place, *kind, *((x.shape, x.dtype, x.requires_grad) for x in inputs)
        if key not in self._passes:
            self._passes[key] = Passes(function, inputs, parameters, [] if module is None else list(module.buffers()))
        return self._passes[key](*inputs)

    def forget(self) -> None:
        """Forget all passes: modules were replaced."""
        self._passes.clear()


class Passes:
    """The forward and the backward pass of a function, recorded with inputs like these.

    `torch.cuda.make_graphed_callables` does not keep what a second backward pass of the same result needs.
    """

    def __init__(
        self,
        function: Callable[..., Tensor],
        inputs: tuple[Tensor, ...],
        parameters: Sequence[Tensor],
        buffers: Sequence[Tensor],
    ) -> None:
        self.inputs = tuple(x.detach().clone().requires_grad_(x.requires_grad) for x in inputs)
        self.parameters = parameters
        before = [buffer.clone() for buffer in buffers]
        self.forward, self.backward = torch.cuda.CUDAGraph(), torch.cuda.CUDAGraph()
        # Weights that are cast once and kept would be those of the recording.
        cast = {"dtype": torch.get_autocast_dtype("cuda"), "enabled": _cast() is not None, "cache_enabled": False}
        with torch.enable_grad(), torch.autocast("cuda", **cast):
            self._record(function)
        with torch.no_grad():  # the passes before left traces
            for buffer, value in zip(buffers, before, strict=True):
                buffer.copy_(value)

    def _record(self, function: Callable[..., Tensor]) -> None:
        # What sums up gradients of parameters is of the stream of the trials from now on; newer PyTorch warns of it.
        quiet = getattr(torch.autograd.graph, "set_warn_on_accumulate_grad_stream_mismatch", None)
        if quiet is not None:
            quiet(False)
        aside = torch.cuda.Stream()
        aside.wait_stream(torch.cuda.current_stream())
        with torch.cuda.stream(aside):
            for _ in range(TRIALS):
                result = function(*self.inputs)
                self._gradients(result, torch.zeros_like(result))
            del result
        torch.cuda.current_stream().wait_stream(aside)
        with torch.cuda.graph(self.forward, capture_error_mode="thread_local"):
            self.result = function(*self.inputs)
        self.of_result, self.gradients = torch.zeros_like(self.result), ()
        if self._sources():
            with torch.cuda.graph(self.backward, pool=self.forward.pool(), capture_error_mode="thread_local"):
                self.gradients = self._gradients(self.result, self.of_result)

    def _sources(self) -> list[Tensor]:
        """What the gradients are by."""
        return [*(x for x in self.inputs if x.requires_grad), *self.parameters]

    def _gradients(self, result: Tensor, of_result: Tensor) -> tuple[Tensor | None, ...]:
        sources = self._sources()
        return torch.autograd.grad(result, sources, of_result, True, allow_unused=True) if sources else ()

    def __call__(self, *inputs: Tensor) -> Tensor:
        return _Replay.apply(self, inputs, *(x for x in inputs if x.requires_grad), *self.parameters)


class _Replay(torch.autograd.Function):
    """The result of recorded passes, and the gradients by those inputs and parameters that have one."""

    @staticmethod
    def forward(ctx: Any, passes: Passes, inputs: tuple[Tensor, ...], *sources: Tensor) -> Tensor:
        ctx.passes = passes
        for held, x in zip(passes.inputs, inputs, strict=True):
            held.copy_(x)
        passes.forward.replay()
        return passes.result.detach()

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> Any:
        passes: Passes = ctx.passes
        passes.of_result.copy_(gradient)
        passes.backward.replay()
        return None, None, *(None if found is None else found.detach() for found in passes.gradients)


def replayable(part: object) -> bool:
    """Whether the own class of a module, projection or penalty says so: what one derived from it does is not known."""
    return "replayable" in vars(type(part)) and bool(getattr(part, "replayable"))  # noqa: B009


def _cast() -> torch.dtype | None:
    return torch.get_autocast_dtype("cuda") if torch.is_autocast_enabled("cuda") else None
