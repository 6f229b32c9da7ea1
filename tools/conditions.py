"""Run commands under hard conditions of the system, and see that each gets the word that it should.

    python tools/conditions.py

A condition is a shell line around `unproject`, the exit status that is right, and a regular expression for what is
said. Those that need to mount a disk or to become somebody else are left out unless this is root.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from fuzz_seeds import CAMPAIGN, ROOT, TOY, picture, run, write

TRAIN = f"$U train {TOY}:toy --views known --steps 4 --quiet --threads 1 --out"
SAMPLE = "$U sample run --trust --n 2 --out"


@dataclass(frozen=True)
class Condition:
    """A name, the shell line, exit status, what is said on stdout and stderr together, and whether root is needed."""

    name: str
    line: str
    status: int
    says: str
    root: bool = False


FULL = "mkdir -p d && mount -t tmpfs -o size=2m tmpfs d && trap 'umount d' EXIT; "
CONDITIONS = (
    Condition("disk full, training", FULL + f"{TRAIN} d/new", 2, r"unproject: d/new.*No space left on device; free some space", True),
    Condition("disk full, samples", FULL + "head -c 2M /dev/zero > d/filler; " + f"{SAMPLE} d/x.npz", 2, r"unproject: d/x.npz: No space left on device; free some space", True),  # noqa: E501
    Condition("a limit on the size of files (`ulimit -f`)", f"ulimit -f 100; {TRAIN} new", 2, r"unproject: new.*File too large; the file system takes no file this large"),  # noqa: E501
    Condition("a folder that may not be written", f"mkdir -p d o && mount --bind o d && mount -o remount,ro,bind d && trap 'umount d' EXIT; {SAMPLE} d/x.npz", 2, r"unproject: d/x.npz: Read-only file system; choose a place that can be written to", True),  # noqa: E501
    Condition("`umask 077`", f"umask 077; {TRAIN} new && stat -c %a new new/recipe.json", 0, r"new: 4 steps[\s\S]*700\n600"),
    Condition("no HOME", f"env -u HOME {TRAIN} new", 0, r"new: 4 steps"),
    Condition("HOME that is not there", f"env HOME=/nonexistent {TRAIN} new", 0, r"new: 4 steps"),
    Condition("TMPDIR that is not there", f"env TMPDIR=/nonexistent {TRAIN} new", 0, r"new: 4 steps"),
    Condition("LANG=C, a name that is not ASCII", "env LANG=C LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0 $U data inspect bilder-ä", 0, r"3"),
    Condition("LANG=C, a name that is not there", "env LANG=C LC_ALL=C PYTHONUTF8=0 PYTHONCOERCECLOCALE=0 $U data inspect fehlt-ä", 2, r"unproject: fehlt-.*there is no such file"),  # noqa: E501
    Condition("stdin closed", f"{TRAIN} new <&-", 0, r"new: 4 steps"),
    Condition("stdout closed", f"{SAMPLE} x.npz >&-; test -s x.npz", 0, r"^(warning: [^\n]*\n)?$"),
    Condition("output to a pipe that is closed (`| head`)", "set -o pipefail; $U recipes | head -1; test ${PIPESTATUS[0]} -le 141", 0, r"^[^\n]+\n$"),  # noqa: E501
    Condition("a terminal of 20 columns", "env COLUMNS=20 $U data inspect bilder-ä && env COLUMNS=20 $U train shapes --help >/dev/null", 0, r"silhouettes"),  # noqa: E501
    Condition("20 columns, a mistake", "env COLUMNS=20 $U train shapes --stesp 4", 2, r"^unproject: train shapes: .*--steps.*\n$"),
    Condition("NO_COLOR", "env NO_COLOR=1 FORCE_COLOR=1 $U train shapes --help", 0, r"^[^\x1b]*$"),
    Condition("1 GiB of memory (`ulimit -v`), few samples", f"ulimit -v 1048576; {SAMPLE} x.npz", 0, r"x.npz: 2 samples"),
    Condition("1 GiB of memory, more samples than fit", "ulimit -v 1048576; $U sample run --trust --n 9000 --size 64 --out x.npz", 2, r"^unproject: [^\n]*(memory|GB)[^\n]*\n$"),  # noqa: E501
    Condition("a time zone on the other side of the date line", f"env TZ=Pacific/Kiritimati {TRAIN} new && TZ=Pacific/Niue $U resume new --trust --quiet --steps 6", 0, r"new: 6 steps"),  # noqa: E501
    Condition("few open files (`ulimit -n 40`)", f"ulimit -n 40; {TRAIN} new", 0, r"new: 4 steps"),
    Condition("pictures on a device", "$U data inspect /dev/zero", 2, r"unproject: /dev/zero: is a pipe, a socket or a device"),
    Condition("a link that points at itself", "mkdir loop && ln -s . loop/a && cp bilder-ä/a.png loop; $U data inspect loop", 0, r"1"),
    Condition("a link to nothing, in a folder", "ln -s missing bilder-ä/z.png; $U data inspect bilder-ä", 0, r"3"),
    Condition("a name of 255 bytes", "cp bilder-ä/a.png bilder-ä/$(printf 'x%.0s' $(seq 251)).png; $U data inspect bilder-ä", 0, r"4"),
    Condition("an output of 255 bytes", f"{SAMPLE} $(printf 'x%.0s' $(seq 251)).npz", 2, r"unproject: x+.npz: File name too long; choose a shorter name"),  # noqa: E501
)  # fmt: skip


def outcome(condition: Condition) -> tuple[int, str]:
    """The exit status and what was said, in a new folder with a run and pictures."""
    folder = Path(tempfile.mkdtemp(prefix="conditions-"))
    folder.chmod(0o755)
    write({name.replace("in/", "run/", 1): data for name, data in run()[0].items()}, folder)
    write({f"bilder-ä/{name}.png": picture("png") for name in "abc"}, folder)
    words = {
        **os.environ,
        "U": f"{sys.executable} -m unproject",
        "OMP_NUM_THREADS": "1",
        "PYTHONPATH": str(ROOT / "src"),
    }
    done = subprocess.run(["bash", "-c", condition.line], cwd=folder, env=words, capture_output=True, timeout=300)
    shutil.rmtree(folder, ignore_errors=True)
    return done.returncode, (done.stdout + done.stderr).decode(errors="backslashreplace")


def main() -> int:
    found, root = [], os.geteuid() == 0
    for condition in CONDITIONS:
        if condition.root and not root:
            continue
        status, said = outcome(condition)
        good = status == condition.status and re.search(condition.says, said) is not None
        found.append({"name": condition.name, "status": status, "said": said.strip()[:400], "good": good})
        print(f"{'good ' if good else 'WRONG'} {condition.name}: {status}: {said.strip()[-300:]!r}", flush=True)
    CAMPAIGN.mkdir(parents=True, exist_ok=True)
    (CAMPAIGN / "conditions.json").write_text(json.dumps(found, indent=1), encoding="utf-8")
    return int(not all(one["good"] for one in found))


if __name__ == "__main__":
    sys.exit(main())
