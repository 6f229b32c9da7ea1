"""How kernels are compiled: for this machine on first use, or for many when a wheel is built.

This module imports nothing of the package, so that `setup.py` can run it by itself. A wheel has each kernel once for
each capability that torch tells processors apart by (`torch.backends.cpu.get_cpu_capability()`), with just the
instructions that torch has looked for.
"""

from __future__ import annotations

import platform
import shutil
import subprocess
from pathlib import Path

FLAGS = ("-O3", "-std=c++17", "-shared", "-fPIC", "-fno-math-errno", "-fno-trapping-math", "-ffp-contract=fast")
AVX2 = ("-mavx2", "-mfma")
AVX512 = (*AVX2, "-mavx512f", "-mavx512bw", "-mavx512dq", "-mavx512vl")
CAPABILITIES = {"DEFAULT": (), "AVX2": AVX2, "AVX512": AVX512}
"""Flags by the processor's capability, the least first; of processors that are no x86-64 only the first."""
SECONDS = 120  # for a build on a busy machine


def compiler() -> str | None:
    """Return the system's C++ compiler, or None."""
    return next((path for path in map(shutil.which, ("c++", "g++", "clang++")) if path), None)


def can_compile() -> bool:
    """Whether a wheel that is built here has compiled kernels: on Linux with a compiler."""
    return platform.system() == "Linux" and compiler() is not None


def compile_kernel(command: str, source: Path, target: Path, flags: tuple[str, ...]) -> None:
    """Compile a source to a shared library.

    Raises:
        OSError, subprocess.SubprocessError: the compiler.
    """
    words = [command, *FLAGS, *flags, "-o", str(target), str(source)]
    subprocess.run(words, capture_output=True, timeout=SECONDS, check=True)


def shipped_name(source: str, capability: str) -> str:
    """Return the name of a kernel in a wheel for this kind of machine."""
    return f"{source}.{platform.machine().lower()}.{capability.lower()}.so"


def compile_all(folder: Path, target: Path) -> list[Path]:
    """Compile each kernel of a folder for each capability; return the libraries in `target`, none without a compiler.

    Raises:
        OSError, subprocess.SubprocessError: the compiler.
    """
    command = compiler() if can_compile() else None
    if command is None:
        return []
    target.mkdir(parents=True, exist_ok=True)
    x86 = platform.machine().lower() in ("x86_64", "amd64")
    made = []
    for source in sorted(folder.glob("*.cpp")):
        for capability in CAPABILITIES if x86 else ("DEFAULT",):
            made.append(target / shipped_name(source.stem, capability))
            compile_kernel(command, source, made[-1], ("-s", *CAPABILITIES[capability]))
    return made
