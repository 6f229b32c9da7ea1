"""Train each recipe at toy size for an hour, and see that its memory stays flat.

    python tools/soak.py                            # all recipes at once, an hour by the clock
    python tools/soak.py --only digits wood --minutes 5

The anonymous resident memory of each training (RssAnon of /proc) is read every few seconds. The median over the last
tenth of the time may be at most 5 % above that over the third; the first two are for what is allocated once: tries, and
the first checkpoint with its preview, at step 500. Records are in tools/campaign/soak.json. Exit status: 1 if memory
grew, or a training failed.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from commits import commit
from fuzz_seeds import CAMPAIGN

IMAGES = "--size 16 --channels 16 --batch 8"
NARROW = f"{IMAGES} --discriminator-channels 8"
MATERIALS = f"{NARROW} --maps 32 --renderings 16 --samples 4"
RECIPES = {
    "shapes": IMAGES,
    "shapes-paper": f"{NARROW} --predictor-steps 60 --predictor-images 512",
    "digits": IMAGES,
    "digits-paper": NARROW,
    **{name: MATERIALS for name in ("materials", "wood", "metal", "plastic", "fabric", "correlated")},
    **{f"{name}-paper": MATERIALS for name in ("wood", "metal", "plastic")},
}
TOLERATED = 0.05


@dataclass
class Soak:
    """How the memory of a training went.

    Attributes:
        megabytes: median of anonymous resident memory in each tenth of the time; None after its end.
        said: the last line of a training that failed, or nothing.
    """

    recipe: str
    steps: int
    minutes: float
    megabytes: list[float | None]
    commit: str
    said: str = ""

    @property
    def growth(self) -> float:
        """Of the last tenth, over the third."""
        _, _, first, *_, last = (held or math.nan for held in self.megabytes)
        return last / first - 1

    @property
    def held(self) -> bool:
        return not self.said and self.growth <= TOLERATED


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", nargs="*", choices=RECIPES, default=list(RECIPES), metavar="RECIPE")
    parser.add_argument("--minutes", type=float, default=60.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="unproject-soak-") as folder:
        soaks = soak(Path(folder), arguments.only, arguments.minutes)
    for one in soaks:
        held = "flat" if one.held else one.said or "GREW"
        print(f"{one.recipe}: {one.steps} steps, {one.megabytes} MB, {one.growth:+.1%}, {held}")
    if arguments.minutes >= 60:
        record(soaks)
    return int(not all(one.held for one in soaks))


def soak(folder: Path, names: list[str], minutes: float) -> list[Soak]:
    """Train the recipes at once, and read their memory until they end."""
    began, at = time.monotonic(), commit()
    running = {name: begin(folder / name, name, minutes) for name in names}
    readings: dict[str, list[tuple[float, float]]] = {name: [] for name in names}
    while any(process.poll() is None for process in running.values()):
        for name, process in running.items():
            if process.poll() is None and (held := megabytes(process.pid)):
                readings[name].append((time.monotonic() - began, held))
        time.sleep(min(5.0, 0.3 * minutes))
    return [told(folder / name, name, process, readings[name], minutes, at) for name, process in running.items()]


def begin(out: Path, name: str, minutes: float) -> subprocess.Popen[bytes]:
    words = f"train {name} {RECIPES[name]} --steps 100000000 --minutes {minutes} --checkpoint-every 500"
    alone = {**os.environ, "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    with out.with_suffix(".txt").open("wb") as said:
        return subprocess.Popen(
            [sys.executable, "-m", "unproject", *words.split(), "--threads", "1", "--quiet", "--out", str(out)],
            stdout=subprocess.DEVNULL,
            stderr=said,
            env=alone,
        )


def megabytes(process: int) -> float:
    """Anonymous resident memory; 0 of a process that is gone."""
    try:
        lines = Path(f"/proc/{process}/status").read_text(encoding="ascii").splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("RssAnon:")), 0.0)


def told(
    out: Path, name: str, process: subprocess.Popen[bytes], readings: list[tuple[float, float]], minutes: float, at: str
) -> Soak:
    """What the readings of a training say, by tenths of the time that it was asked to take."""
    tenths = [[held for when, held in readings if int(when / (6 * minutes)) == k] for k in range(10)]
    medians = [round(statistics.median(tenth), 1) if tenth else None for tenth in tenths]
    lines = out.with_suffix(".txt").read_text(encoding="utf-8", errors="replace").splitlines()
    said = (lines or [f"exit status {process.returncode}"])[-1] if process.returncode else ""
    steps = [int(path.stem.removeprefix("step-")) for path in (out / "checkpoints").glob("*.safetensors")]
    return Soak(name, max(steps, default=0), minutes, medians, at, said)


def record(soaks: list[Soak]) -> None:
    """Keep the soaks, in the place of earlier ones of the same recipes."""
    file = CAMPAIGN / "soak.json"
    known = json.loads(file.read_text(encoding="utf-8")) if file.exists() else []
    kept = {entry["recipe"]: entry for entry in known} | {one.recipe: asdict(one) for one in soaks}
    text = json.dumps([kept[name] for name in RECIPES if name in kept], indent=1) + "\n"
    unfinished = file.with_suffix(".new")
    unfinished.write_text(text, encoding="utf-8")
    unfinished.replace(file)


if __name__ == "__main__":
    sys.exit(main())
