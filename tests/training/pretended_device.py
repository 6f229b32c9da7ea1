"""A pretended second device: tensors that lie on the processor, say that they are on "cuda:0", and may not be mixed.

Where no GPU is at hand, a forgotten `.to(device)` shows on users' machines only. Within `pretended_device()` a tensor
that was made on, or moved to, "cuda" is real, so that all of a training step runs, but

- `tensor.device` and `is_cuda` say so, and new tensors made from it are there too;
- an operation on tensors of both devices raises, as on a GPU, but for single values and indices of the processor;
- `numpy()`, `data_ptr()` (which kernels of the processor take) and draws by a generator of the processor raise.

It knows what operations torch refuses, not what they cost, nor what a GPU would compute.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor
from torch.multiprocessing.reductions import StorageWeakRef
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode

from unproject.ops import band_statistics, pyramids
from unproject.projections import rendering

DEVICE = torch.device("cuda:0")
PROCESSOR = torch.device("cpu")
ACROSS = {"copy_", "set_"}
"""Operations on tensors of two devices, whose result stays where it is."""
INDEXED = {"index", "index_put", "index_put_", "_index_put_impl_", "_unsafe_index", "_unsafe_index_put"}
"""Operations whose first tensor may be on the device while indices are not."""
UNSEEN = {"__deepcopy__", "new_tensor"}
"""Functions that make a tensor where their first one is, past all operations."""
KEPT_ON_A_DEVICE = (band_statistics.area_matrix, pyramids._placed, rendering._placed)
"""Functions that keep tensors, of which another pretended device would not know."""
CROSSED: list[str] = []
"""Functions that moved something from one device to the other, so far."""
OF_PROCESSOR = {"numpy", "data_ptr", "__array__"}


class DeviceError(AssertionError):
    """What a GPU would have refused."""


def tensors_in(value: Any) -> Iterator[Tensor]:
    """The tensors of nested arguments or results; torch's own way through them takes most of the time here."""
    if isinstance(value, Tensor):
        yield value
    elif isinstance(value, (tuple, list)):
        for part in value:
            yield from tensors_in(part)
    elif isinstance(value, dict):
        yield from tensors_in(list(value.values()))


class Storages:
    """The storages that are on the pretended device.

    Attributes:
        within: whether a function of torch runs on tensors that are there: it sees where they truly are, so that what
            it makes itself belongs to them.
    """

    def __init__(self) -> None:
        self.kept: dict[int, StorageWeakRef] = {}
        self.within = False

    def hold(self, x: Tensor) -> bool:
        found = self.kept.get(x.untyped_storage()._cdata)
        return found is not None and not found.expired()

    def mark(self, x: Tensor, there: bool) -> None:
        reference = StorageWeakRef(x.untyped_storage())
        self.kept.pop(reference.cdata, None)
        if there:
            self.kept[reference.cdata] = reference


class Dispatch(TorchDispatchMode):
    """Check the devices of every operation, and hand them on to its results."""

    def __init__(self, there: Storages) -> None:
        super().__init__()
        self.there = there

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        tensors = list(tensors_in((args, kwargs)))
        held = [self.there.hold(x) for x in tensors]
        name = func.__name__.split(".")[0]
        here = [x for x, on_device in zip(tensors, held, strict=True) if not on_device and x.dim() > 0]
        if name in INDEXED and held and held[0]:
            here = []
        if any(held) and here and name not in ACROSS:
            shapes = [(tuple(x.shape), "device" if on else "processor") for x, on in zip(tensors, held, strict=True)]
            raise DeviceError(f"{name}: tensors on two devices, {shapes}")
        result = func(*args, **(kwargs or {}))
        if any(held) and name not in ACROSS or self.there.within and not tensors:
            for x in tensors_in(result):
                self.there.mark(x, True)
        return result


class Functions(TorchFunctionMode):
    """Pretend where tensors are, and move them."""

    def __init__(self, there: Storages) -> None:
        super().__init__()
        self.there = there

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = dict(kwargs or {})
        name = getattr(func, "__name__", "")
        read = getattr(getattr(func, "__self__", None), "__name__", "") if name == "__get__" else ""
        if read in ("device", "is_cuda") and self.there.hold(args[0]):
            return DEVICE if read == "device" else True
        if name in OF_PROCESSOR and self.there.hold(args[0]):
            raise DeviceError(f"{name}() of a tensor on the device")
        if func in (Tensor.to, Tensor.cpu, Tensor.cuda):
            return self.moved(name, *args, **kwargs)
        if name in UNSEEN and kwargs.get("device") is None:
            return self.marked(func(*args, **kwargs), self.there.hold(args[0]))
        if kwargs.get("device") is None:
            return self.run(func, *args, **kwargs)
        there = torch.device(kwargs.pop("device")).type == DEVICE.type
        if there and kwargs.get("generator") is not None:
            raise DeviceError(f"{name}: a generator of the processor draws for the device")
        made = func(*args, **kwargs, device=PROCESSOR)
        if there and name in ("tensor", "as_tensor"):
            CROSSED.append(name)
        return self.marked(made, there)

    def run(self, func: Any, *args: Any, **kwargs: Any) -> Any:
        """Call a function of torch that makes tensors where those that it is given are."""
        before = self.there.within
        self.there.within = any(map(self.there.hold, tensors_in((args, kwargs))))
        try:
            return func(*args, **kwargs)
        finally:
            self.there.within = before

    def moved(self, name: str, x: Tensor, *args: Any, **kwargs: Any) -> Tensor:
        """Return `x.to(...)`, `x.cpu()` or `x.cuda()`."""
        target = {"cpu": PROCESSOR, "cuda": DEVICE}.get(name)
        rest: list[Any] = []
        for value in (*args, *((kwargs.pop("device"),) if "device" in kwargs else ())):
            if isinstance(value, Tensor):
                target = DEVICE if self.there.hold(value) else PROCESSOR
                rest.append(value.dtype)
            elif isinstance(value, (str, torch.device)):
                target = torch.device(value)
            elif isinstance(value, torch.dtype):
                rest.append(value)
        held = self.there.hold(x)
        there = held if target is None else target.type == DEVICE.type
        moved = Tensor.to(x, *rest, **kwargs) if rest or kwargs else x
        if there == held:
            return moved
        CROSSED.append(name)
        same = moved.untyped_storage()._cdata == x.untyped_storage()._cdata
        return self.marked(moved.clone() if same else moved, there)

    def marked(self, made: Any, there: bool) -> Any:
        for x in tensors_in(made):
            self.there.mark(x, there)
        return made


@contextmanager
def pretended_device() -> Iterator[torch.device]:
    """Pretend that "cuda:0" is there; give it."""
    there = Storages()
    with Dispatch(there), Functions(there):
        try:
            yield DEVICE
        finally:
            for kept in KEPT_ON_A_DEVICE:
                kept.cache_clear()
