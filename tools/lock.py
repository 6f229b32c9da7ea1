"""Write requirements.lock: what the package needs at run time, pinned as in constraints.txt, with hashes of all files.

    python tools/lock.py --torch torch-2.13.0+cpu-cp311-cp311-manylinux_2_28_x86_64.whl

    pip install --require-hashes --no-deps -r requirements.lock    # an environment of exactly these files

It needs uv. Of torch only the CPU builds given by --torch may be installed: those of the index need several gigabytes
of packages for GPUs, which are left out.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import subprocess
from pathlib import Path

ROOT = Path(__file__).parents[1]
LOCK = ROOT / "requirements.lock"
OF_GPUS = re.compile(r"^(nvidia-|cuda-|triton==)")
HEAD = "# Made by tools/lock.py from pyproject.toml and constraints.txt, for pip install --require-hashes -r\n"


def compiled() -> str:
    """Return pins with hashes, as uv resolves them."""
    words = ["uv", "pip", "compile", "pyproject.toml", "-c", "constraints.txt", "--generate-hashes", "--universal"]
    words += ["--python-version", "3.11", "--no-annotate", "--no-header", "--quiet"]
    return subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout


def locked(text: str, builds: list[Path]) -> str:
    """Return the pins without those of GPUs, and of torch these builds."""
    pins = [pin for pin in re.split(r"\n(?=\S)", text.strip()) if not OF_GPUS.match(pin)]
    hashes = [f" \\\n    --hash=sha256:{hashlib.sha256(build.read_bytes()).hexdigest()}" for build in builds]
    pins = [pin.split()[0] + "".join(hashes) if pin.startswith("torch==") else pin for pin in pins]
    return HEAD + "\n".join(pins) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description="Write requirements.lock.")
    parser.add_argument("--torch", type=Path, nargs="+", required=True, help="CPU builds of torch")
    args = parser.parse_args()
    LOCK.write_text(locked(compiled(), args.torch), encoding="utf-8")


if __name__ == "__main__":
    main()
