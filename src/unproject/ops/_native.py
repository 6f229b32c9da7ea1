"""Kernels in C++: those that came with the package, or compiled on first use; without either, torch has the values.
On a GPU kernels in Triton take their place.

`kernel("line_integrals", "line_integrals_float")` is a function of `ops/line_integrals.cpp` that takes pointers and
numbers, or None without a compiler, if compilation fails, or with UNPROJECT_NATIVE=0. A wheel has each kernel for
several kinds of processors (`_builds`), and the best that this one can run is taken. A build takes about two seconds
and is cached in the user's cache folder, under a name that changes with the source, the compiler and the processor.
Each kernel has a plain torch reference, and tests compare the two.
"""

from __future__ import annotations

import ctypes
import hashlib
import importlib
import importlib.util
import os
import platform
import subprocess
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .._files import atomic_path
from . import _builds

SHIPPED = Path(__file__).parent / "kernels"


def kernel(source: str, name: str) -> Callable[..., None] | None:
    """Return the C function `name` of ops/SOURCE.cpp, or None; it raises MemoryError where memory is used up."""
    library = _library(source) if os.environ.get("UNPROJECT_NATIVE", "1") != "0" else None
    return None if library is None else getattr(library, name)


def gpu_kernels(source: str, like: Tensor) -> Any:
    """Return the module ops/SOURCE_triton.py for tensors like this one, or None: without Triton, or not on a GPU.

    PyTorch brings Triton along where it can use a GPU.
    """
    if not like.is_cuda or os.environ.get("UNPROJECT_NATIVE", "1") == "0" or not _has_triton():
        return None
    return importlib.import_module(f".{source}_triton", __package__)


@cache
def _has_triton() -> bool:
    return importlib.util.find_spec("triton") is not None


def pointer(x: Tensor) -> ctypes.c_void_p:
    """Return the address of the elements of a contiguous tensor."""
    assert x.is_contiguous()
    return ctypes.c_void_p(x.data_ptr())


def divided(count: int, part: Callable[[int, int], None]) -> None:
    """Call part(start, end) for equal parts of a batch of `count`, each on one of torch's threads."""
    few = -(-count // torch.get_num_threads()) or 1
    starts = range(0, count, few)
    if len(starts) < 2:
        for start in starts:
            part(start, count)
        return
    with ThreadPoolExecutor(len(starts)) as pool:
        list(pool.map(lambda start: part(start, min(start + few, count)), starts))


class _Kernels(ctypes.CDLL):
    """Functions that return 0, or 1 where memory was used up: no exception passes through C (`status.h`)."""

    def __getitem__(self, name_or_ordinal: Any) -> Any:
        function = super().__getitem__(name_or_ordinal)
        function.errcheck = _checked
        return function


def _checked(status: Any, function: Any, arguments: Any) -> Any:
    if status:
        raise MemoryError(f"{function.__name__}: memory is used up")


@cache
def _library(source: str) -> Any:
    return _shipped(source) or _compiled(source)


def _shipped(source: str) -> Any:
    """Return the library of a wheel for this processor, or None."""
    known = list(_builds.CAPABILITIES)
    capability = torch.backends.cpu.get_cpu_capability()
    for name in reversed(known[: known.index(capability) + 1] if capability in known else known[:1]):
        try:
            return _Kernels(str(SHIPPED / _builds.shipped_name(source, name)))
        except OSError:  # not there, or of another system
            continue
    return None


def _compiled(source: str) -> Any:
    compiler = _builds.compiler()
    file = Path(__file__).parent / f"{source}.cpp"
    if compiler is None:
        return None
    # Not every compiler supports -march=native.
    return _built(compiler, file, ("-march=native",)) or _built(compiler, file, ())


def _built(compiler: str, source: Path, flags: tuple[str, ...]) -> Any:
    try:
        words = [compiler, "--version"]
        version = subprocess.run(words, capture_output=True, timeout=_builds.SECONDS, check=True).stdout
        key = _key(version, *_sources(source), *_builds.FLAGS, *flags, _processor())
        target = _cache() / f"{source.stem}-{key}.so"
        if not target.exists():
            with atomic_path(target) as temporary:
                _builds.compile_kernel(compiler, source, temporary, flags)
        return _Kernels(str(target))
    except (OSError, subprocess.SubprocessError, RuntimeError):  # the last of a machine without a home
        return None


def _sources(source: Path) -> list[bytes]:
    """Read the source and the headers in its folder."""
    return [file.read_bytes() for file in (source, *sorted(source.parent.glob("*.h")))]


def _cache() -> Path:
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(home) / "unproject"
    folder.mkdir(parents=True, exist_ok=True, mode=0o700)
    return folder


def _key(*parts: bytes | str) -> str:
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part if isinstance(part, bytes) else part.encode())
    return digest.hexdigest()[:16]


def _processor() -> str:
    """Return the processor's features, on which -march=native depends: machines may share a cache folder."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line for line in lines if line.startswith(("flags", "Features")))
    except (OSError, StopIteration):
        return f"{platform.processor()} {platform.machine()}"
