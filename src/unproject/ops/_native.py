"""Kernels in C++, compiled on first use by the system's compiler; without one the same values come from torch.

`kernel("line_integrals", "line_integrals_float")` is a function of `ops/line_integrals.cpp` that takes pointers and
numbers, or None without a compiler, if compilation fails, or with UNPROJECT_NATIVE=0. A build takes about two seconds
and is cached in the user's cache folder, under a name that changes with the source, the compiler and the processor.
Each kernel has a plain torch reference, and tests compare the two.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import subprocess
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from torch import Tensor

from .._files import atomic_path

FLAGS = ("-O3", "-std=c++17", "-shared", "-fPIC", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")
SECONDS = 120  # for a build on a busy machine


def kernel(source: str, name: str) -> Callable[..., None] | None:
    """Return the C function `name` of ops/SOURCE.cpp, or None."""
    library = _library(source) if os.environ.get("UNPROJECT_NATIVE", "1") != "0" else None
    return None if library is None else getattr(library, name)


def pointer(x: Tensor) -> ctypes.c_void_p:
    """Return the address of the elements of a contiguous tensor."""
    assert x.is_contiguous()
    return ctypes.c_void_p(x.data_ptr())


@cache
def _library(source: str) -> Any:
    compiler = next((path for path in map(shutil.which, ("c++", "g++", "clang++")) if path), None)
    file = Path(__file__).parent / f"{source}.cpp"
    if compiler is None:
        return None
    # Not every compiler supports -march=native.
    return _built(compiler, file, (*FLAGS, "-march=native")) or _built(compiler, file, FLAGS)


def _built(compiler: str, source: Path, flags: tuple[str, ...]) -> Any:
    try:
        version = subprocess.run([compiler, "--version"], capture_output=True, timeout=SECONDS, check=True).stdout
        target = _cache() / f"{source.stem}-{_key(version, *_sources(source), *flags, _processor())}.so"
        if not target.exists():
            with atomic_path(target) as temporary:
                command = [compiler, *flags, "-o", str(temporary), str(source)]
                subprocess.run(command, capture_output=True, timeout=SECONDS, check=True)
        return ctypes.CDLL(str(target))
    except (OSError, subprocess.SubprocessError):
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
