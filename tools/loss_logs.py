"""Compare the loss logs of two versions: a change that leaves the numbers alone leaves every line the same.

    python tools/loss_logs.py record before/                          # at the old version
    python tools/loss_logs.py record after/                           # at the new one
    python tools/loss_logs.py compare before/ after/

`record` trains every recipe for 60 steps, seeds 0 and 1, with one thread, and keeps of each run the lines of
stats.jsonl without the seconds, and a digest of the averaged weights. The paper's recipes are narrow, as in the cpu
budget of `unproject reproduce`: at full width they would take hours. Exit status: 0 if all were trained, and if logs
were compared that are all the same and in both folders; else 1.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

STEPS, SEEDS = 60, (0, 1)
NARROW = "--discriminator-channels 16"
NARROW_SHAPES = f"--size 32 --channels 32 {NARROW} --batch 8 --predictor-steps 60 --predictor-images 512"
NARROW_MATERIALS = f"--channels 128 {NARROW} --batch 16 --samples 8"
ARMS = {
    "shapes": "shapes --rounds 2",
    "shapes-guess": "shapes --rounds 2 --init-views",
    "shapes-known": "shapes --views known --bands 2",
    "shapes-learned": "shapes --views learned",
    "shapes-single": "shapes --views single --flips",
    "shapes-direct": "shapes --views direct",
    "shapes-bfloat16": "shapes --views known --precision bfloat16",
    "shapes-paper": f"shapes-paper {NARROW_SHAPES}",
    "shapes-paper-clusters": f"shapes-paper {NARROW_SHAPES} --clusters 8 --released",
    "shapes-paper-hinge": f"shapes-paper {NARROW_SHAPES} --views known --loss hinge",
    "digits": "digits",
    "digits-predicted": "digits --views predicted --rounds 2 --shift 2",
    "digits-learned": "digits --views learned",
    "digits-single": "digits --views single",
    "digits-direct": "digits --views direct",
    "digits-paper": "digits-paper --channels 128 --discriminator-channels 16",
    "digits-paper-learned": "digits-paper --channels 128 --discriminator-channels 16 --views learned",
    "wood": "wood",
    "wood-direct": "wood --views direct",
    "wood-natural": "wood --observations diffuse top grazing flash lamp raking --flips",
    "metal": "metal",
    "plastic": "plastic",
    "fabric": "fabric",
    "correlated": "correlated",
    "wood-paper": f"wood-paper {NARROW_MATERIALS}",
    "metal-paper": f"metal-paper {NARROW_MATERIALS}",
    "plastic-paper": f"plastic-paper {NARROW_MATERIALS} --views direct",
}


def record(folder: Path) -> int:
    """How many trainings failed; each is named."""
    folder.mkdir(parents=True, exist_ok=True)
    jobs = [(name, seed) for name in ARMS for seed in SEEDS if not (folder / f"{name}-{seed}.jsonl").exists()]
    failed = 0
    with ThreadPoolExecutor(2) as pool:
        for (name, seed), trouble in zip(jobs, pool.map(lambda job: train(folder, *job), jobs)):
            failed += bool(trouble)
            print(f"{name}-{seed}: {trouble or 'recorded'}", flush=True)
    return failed


def train(folder: Path, name: str, seed: int) -> str:
    """Train one arm in a process of its own; what went wrong, or nothing."""
    with tempfile.TemporaryDirectory() as out:
        words = [*ARMS[name].split(), "--seed", str(seed), "--steps", str(STEPS), "--out", f"{out}/run", "--quiet"]
        alone = {**os.environ, "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
        command = [sys.executable, "-m", "unproject", "train", *words, "--threads", "1"]
        done = subprocess.run(command, capture_output=True, text=True, env=alone)
        if done.returncode:
            return (done.stderr.strip().splitlines() or ["killed"])[-1]
        (folder / f"{name}-{seed}.jsonl").write_text(log_of(Path(out) / "run"), encoding="utf-8")
    return ""


def log_of(run: Path) -> str:
    """The lines without the seconds, and a digest of the averaged weights."""
    from safetensors.torch import load_file

    text = (run / "stats.jsonl").read_text(encoding="utf-8")
    lines = [json.loads(line) for line in text.splitlines()]
    rest = [json.dumps({k: v for k, v in line.items() if k != "seconds"}) for line in lines]
    digest = hashlib.sha256()
    tensors = load_file(max((run / "checkpoints").glob("*.safetensors")))
    for key in sorted(key for key in tensors if key.startswith("average/")):
        digest.update(tensors[key].numpy().tobytes())
    return "\n".join([*rest, json.dumps({"weights": digest.hexdigest()})]) + "\n"


def compare(before: Path, after: Path) -> int:
    """How many logs differ or are in one folder alone, each is named; 1 if there are none to compare."""
    names = sorted({path.name for folder in (before, after) for path in folder.glob("*.jsonl")})
    different = 0
    for name in names:
        missing = [folder for folder in (before, after) if not (folder / name).exists()]
        same = not missing and renamed(before / name) == renamed(after / name)
        different += not same
        found = f"MISSING in {missing[0]}" if missing else "identical" if same else "DIFFERENT"
        print(f"{name.removesuffix('.jsonl')}: {found}")
    print(f"{different} differ" if names else f"{before} and {after} hold no logs")
    return different if names else 1


def renamed(log: Path) -> str:
    """The text of a log, with names of fields and events that have changed as they are now."""
    text = log.read_text(encoding="utf-8")
    for old, new in (('"ways":', '"views":'), ('"guessed"', '"initialised"')):
        text = text.replace(old, new)
    return text


if __name__ == "__main__":
    action, *folders = sys.argv[1:]
    sys.exit(bool(record(Path(folders[0])) if action == "record" else compare(*map(Path, folders))))
