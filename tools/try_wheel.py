"""Install a wheel in clean environments, without the repository and without a compiler, and run what it promises.

    python tools/try_wheel.py dist/unproject-*.whl --python python3.11 python3.13
    python tools/try_wheel.py dist/unproject-*.whl --python python3.10 --lowest   # the lowest versions it says it takes

An environment is made in --envs for each interpreter, or used if it is there; a build of torch that was put there by
hand is kept. The commands run in an empty folder, with the environment's programs alone on the path. Prints a table and
exits with 1 if a command failed or a kernel was not the wheel's own.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
import time
import zipfile
from email.parser import Parser
from pathlib import Path

COMMANDS = (
    "--help",
    "demo --minutes 0.2 --out demo",
    "train digits --steps 3 --batch 4 --quiet --out digits",
    "train wood --steps 2 --batch 2 --quiet --out wood",
    "sample digits --n 4 --out samples.npz",
    "export wood --to maps --n 2 --out maps",
    "evaluate digits --n 10",
    "reproduce fig1",
)
SHIPPED = """
import torch, numpy, unproject
from unproject.ops import _native
libraries = {source: _native._library(source) for source in ("line_integrals", "ray_rules", "shading", "straight_rays")}
own = all(library and "/kernels/" in library._name for library in libraries.values())
print(torch.__version__, numpy.__version__, torch.backends.cpu.get_cpu_capability(), "own" if own else "NONE")
"""


def lowest_versions(wheel: Path) -> list[str]:
    """Return what a wheel needs, each at the lowest version that it says."""
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        needed = Parser().parsestr(archive.read(name).decode()).get_all("Requires-Dist", [])
    return [re.sub(r"\s*>=\s*", "==", line) for line in needed if "extra ==" not in line]


def environment(python: str, wheel: Path, folder: Path, lowest: bool) -> Path:
    """Return the folder of programs of an environment in which the wheel is installed."""
    programs = folder / (Path(python).name + ("-lowest" if lowest else "")) / "bin"
    if not programs.exists():
        subprocess.run([python, "-m", "venv", programs.parent], check=True)
    pip = [programs / "python", "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    subprocess.run([*pip, *(lowest_versions(wheel) if lowest else ()), wheel], check=True)
    subprocess.run([*pip, "--force-reinstall", "--no-deps", wheel], check=True)
    return programs


def tried(programs: Path) -> tuple[str, list[tuple[str, int, float, str]]]:
    """Return the versions, and for each command its exit status, seconds and last line of errors."""
    with tempfile.TemporaryDirectory() as place:
        only = {"PATH": str(programs), "HOME": place, "OMP_NUM_THREADS": "1"}
        words = [programs / "python", "-c", SHIPPED]
        found = subprocess.run(words, cwd=place, env=only, capture_output=True, text=True)
        rows = []
        for command in COMMANDS:
            began = time.monotonic()
            words = [programs / "unproject", *command.split()]
            ended = subprocess.run(words, cwd=place, env=only, capture_output=True, text=True)
            errors = ended.stderr.strip().splitlines()
            rows.append((command, ended.returncode, time.monotonic() - began, errors[-1] if errors else ""))
    return found.stdout.strip() or found.stderr.strip().splitlines()[-1], rows


def main() -> None:
    parser = argparse.ArgumentParser(description="Try a wheel in clean environments.")
    parser.add_argument("wheel", type=Path)
    parser.add_argument("--python", nargs="+", default=[sys.executable])
    parser.add_argument("--lowest", action="store_true")
    parser.add_argument("--envs", type=Path, default=None)
    args = parser.parse_args()
    sound = True
    with tempfile.TemporaryDirectory() as temporary:
        for python in args.python:
            programs = environment(python, args.wheel.absolute(), args.envs or Path(temporary), args.lowest)
            versions, rows = tried(programs)
            sound &= versions.endswith("own")
            print(f"\n{python}: torch, numpy, processor, kernels: {versions}")
            for command, status, seconds, error in rows:
                sound &= status == 0
                print(f"{'ok' if status == 0 else status:>4} {seconds:6.1f} s  unproject {command}  {error[:160]}")
    sys.exit(not sound)


if __name__ == "__main__":
    main()
