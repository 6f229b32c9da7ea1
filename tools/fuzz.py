"""Give the command line damaged and hostile inputs, each in a process of its own, and report what it should not have done.

    python tools/fuzz.py png                      # 200 inputs of one family
    python tools/fuzz.py png --seed 1 --only 57   # one input again; its folder is kept and named
    python tools/fuzz.py flags --n 1000           # random flags and values instead of files
    python tools/fuzz.py --campaign --n 10000 --jobs 2   # all families, two at a time, to 10,000 inputs each

With --campaign what became of inputs 0, 1, ... of a family is recorded in tools/campaign, a block at a time, and goes on
where the record ends; it says at which commits which inputs were tried. Delete a family's record to begin it anew.

Input `k` of a family and seed is always the same: a good seed, mutated (`fuzz_mutations.py`), and a command that reads
it (`fuzz_seeds.py`). The command runs in a forked child of a process that has imported everything, which takes
milliseconds, with a limit on memory and time. It may end with

    0    and nothing on stderr but lines that begin with `warning: ` or `skipped `, or
    2    and one printable line on stderr that begins with `unproject: `, with no output left behind (after one that
         says that training was rolled back, where it was; a training that broke down has begun, and its run stays),

within the time, and in 512 MiB and 20 times the input. All else is a finding. Exit status: 1 if there is one.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import re
import resource
import shlex
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import zlib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"  # threads do not survive a fork

import fuzz_flags
import numpy as np
from commits import commit
from fuzz_seeds import CAMPAIGN, FAMILIES, Tree, clear, write

MEMORY, TIMES, ADDRESSES, SECONDS, PATIENCE = 2**29, 20, 2**31, 60, 10
"""Bytes that a command may take, and how many more for each byte of input; addresses; seconds of the processor, and how
many times more by the clock, since others may use the machine."""
BLOCK = 500
"""Inputs between two records."""
SAID = re.compile(r"(training [^\n]+; rolling back to step \d+[^\n]+\n)?unproject: [^\n]+\n")
REMARKS = re.compile(r"((warning: |skipped )[^\n]*\n)*")
UNFINISHED = ("*/.*.tmp*", ".*.tmp*", "out", "out.*", ".tmp*")
BROKE_DOWN = "training broke down"


@dataclass
class Input:
    """A command and the files that it reads."""

    words: list[str]
    tree: Tree


@dataclass
class Ended:
    """How a command ended: exit status (below 0: the signal), stderr, bytes and seconds that it took."""

    status: int
    stderr: str
    memory: int
    seconds: float


@dataclass
class Report:
    """What became of a family's inputs: those from `first` on, `inputs` of them.

    Attributes:
        fixed: findings that were none any more when the campaign went on.
        commits: at which commit how many of them were tried.
    """

    family: str
    seed: int
    first: int = 0
    inputs: int = 0
    refused: int = 0
    seconds: float = 0.0
    findings: dict[int, str] = field(default_factory=dict)
    fixed: dict[int, str] = field(default_factory=dict)
    commits: dict[str, int] = field(default_factory=dict)

    def with_next(self, block: Report) -> Report:
        """Return the report of these inputs and of the block that follows them."""
        commits = Counter(self.commits) + Counter(block.commits)
        return Report(
            self.family,
            self.seed,
            self.first,
            self.inputs + block.inputs,
            self.refused + block.refused,
            round(self.seconds + block.seconds, 1),
            self.findings | block.findings,
            self.fixed,
            dict(commits),
        )


def read_report(file: Path) -> Report:
    found = json.loads(file.read_text(encoding="utf-8"))
    numbered = {name: {int(k): said for k, said in found[name].items()} for name in ("findings", "fixed")}
    return Report(**{**found, **numbered})


def write_report(report: Report, file: Path) -> None:
    """Write a record as a whole, or not at all."""
    file.parent.mkdir(parents=True, exist_ok=True)
    unfinished = file.with_suffix(".new")
    unfinished.write_text(json.dumps(asdict(report), indent=1) + "\n", encoding="utf-8")
    unfinished.replace(file)


class Inputs:
    """The inputs of a family: `inputs[k]`."""

    def __init__(self, family: str, seed: int) -> None:
        self.family, self.seed = family, seed
        self.seeds = [{}] if family == "flags" else FAMILIES[family].seeds()

    def good(self) -> list[Input]:
        """Each command with a good seed."""
        if self.family == "flags":
            return [self[k] for k in range(20)]
        return [Input(shlex.split(command), self.seeds[0]) for command in FAMILIES[self.family].commands]

    def __getitem__(self, k: int) -> Input:
        rng = np.random.default_rng([self.seed, zlib.crc32(self.family.encode()), k])
        if self.family == "flags":
            return Input(fuzz_flags.words(rng), fuzz_flags.tree())
        family, tree = FAMILIES[self.family], dict(self.seeds[int(rng.integers(len(self.seeds)))])
        targets = [name for name in tree if re.search(family.target, name)]
        name = targets[int(rng.integers(len(targets)))]
        tree[name] = family.mutation(tree[name], rng)
        return Input(shlex.split(family.commands[int(rng.integers(len(family.commands)))]), tree)


def child(words: list[str], folder: Path) -> None:
    """Run a command in this process, which ends with it."""
    status = 99
    try:
        os.chdir(folder)
        resource.setrlimit(resource.RLIMIT_AS, (mapped() + ADDRESSES,) * 2)
        signal.setitimer(signal.ITIMER_REAL, PATIENCE * SECONDS)
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
        for number, name in ((0, os.devnull), (1, "stdout"), (2, "stderr")):
            os.dup2(os.open(name, os.O_RDWR | os.O_CREAT), number)
        sys.stdout, sys.stderr = os.fdopen(1, "w", closefd=False), os.fdopen(2, "w", buffering=1, closefd=False)
        sys.argv = ["unproject", *words]
        from unproject.cli import main

        status = main()
    except SystemExit as end:
        status = end.code if isinstance(end.code, int) else 98
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def mapped() -> int:
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()


def run(words: list[str], folder: Path, idle: int = 0) -> Ended:
    """Run a command in a forked child; `idle` is what a child takes that does nothing."""
    began = time.monotonic()
    sys.stdout.flush()  # a child would write what is buffered again
    pid = os.fork()
    if not pid:
        child(words, folder)
    _, status, used = os.wait4(pid, 0)
    text = (folder / "stderr").read_bytes().decode(errors="backslashreplace") if (folder / "stderr").exists() else ""
    memory = used.ru_maxrss * 1024 - idle
    return Ended(os.waitstatus_to_exitcode(status), text, memory, time.monotonic() - began)


def wrong(ended: Ended, folder: Path, size: int) -> str:
    """What a command should not have done, or nothing."""
    if ended.status in (-signal.SIGALRM, -signal.SIGXCPU, -signal.SIGKILL):
        return f"hangs: over {SECONDS} s"
    if ended.status < 0:
        return f"signal {-ended.status}"
    if "Traceback" in ended.stderr or ended.status not in (0, 2):
        return f"status {ended.status}: {last_frame(ended.stderr)}"
    if ended.memory > MEMORY + TIMES * size:
        return f"{ended.memory >> 20} MiB for {size} bytes"
    if ended.status == 0:
        return "" if REMARKS.fullmatch(ended.stderr) else f"stderr: {ended.stderr[:200]!r}"
    if not SAID.fullmatch(ended.stderr) or not ended.stderr.replace("\n", "").isprintable():
        return f"stderr: {ended.stderr[:300]!r}"
    left = [path.name for pattern in UNFINISHED for path in folder.glob(pattern)]
    if BROKE_DOWN in ended.stderr:  # its log says how
        left = [name for name in left if not (folder / name / "recipe.json").is_file()]
    return f"left behind: {', '.join(left)}" if left else ""


def last_frame(text: str) -> str:
    """The last line of the package's own in a traceback, and the error."""
    own = re.findall(r'File "[^"]*/(unproject/[^"]+)", line (\d+), in (\S+)', text)
    error = text.strip().splitlines()[-1][:160] if text.strip() else "nothing said"
    return f"{':'.join(own[-1][:2])} {error}" if own else error


def fuzz(family: str, seed: int, numbers: range, keep: bool = False, minutes: float = 60) -> Report:
    """Run some inputs of a family."""
    report, inputs = Report(family, seed, numbers.start), Inputs(family, seed)
    top = Path(tempfile.mkdtemp(prefix="fuzz-", dir=os.environ.get("FUZZ_FOLDER")))
    preload(inputs.good(), top)
    idle = run(["--version"], top).memory
    began = time.monotonic()
    for k in numbers:
        if time.monotonic() - began > 60 * minutes:
            break
        one, folder = inputs[k], top / str(k)
        folder.mkdir()
        write(one.tree, folder)
        ended = run(one.words, folder, idle)
        size = ADDRESSES if family == "flags" else sum(map(len, one.tree.values()))  # flags may ask for large networks
        found = wrong(ended, folder, size)
        if found.startswith("hangs") and family == "flags" and fuzz_flags.asks_for_hours(one.words):
            found = ""
        report.inputs += 1
        report.refused += ended.status == 2
        if found:
            report.findings[k] = f"{shlex.join(one.words)[:200]}: {found}"
            print(f"{family} {k}: {report.findings[k]}", flush=True)
        if keep:
            print(
                f"{folder}: unproject {shlex.join(one.words)}\n{ended.status}, {ended.memory >> 20} MiB, {ended.seconds:.1f} s\n{ended.stderr}"
            )
        else:
            clear(folder)
    if not keep:
        clear(top)
    report.seconds = time.monotonic() - began
    return report


def preload(inputs: list[Input], top: Path) -> None:
    """Import what commands import, so that their children have it: which modules these are a child says."""
    pid = os.fork()
    if not pid:
        from unproject.cli import main

        os.dup2(os.open(os.devnull, os.O_RDWR), 2)
        os.dup2(2, 1)
        for one in inputs:
            folder = Path(tempfile.mkdtemp(dir=top))
            write(one.tree, folder)
            os.chdir(folder)
            with contextlib.suppress(BaseException):
                main(one.words)
        (top / "modules").write_text("\n".join(sys.modules), encoding="utf-8")
        os._exit(0)
    os.waitpid(pid, 0)
    for name in (top / "modules").read_text(encoding="utf-8").split("\n"):
        try:
            __import__(name)
        except Exception:  # parts of packages that are made while they run
            continue
    from unproject.cli import _parsed

    for one in inputs[:8]:
        with contextlib.suppress(ValueError):
            _parsed(one.words[0], one.words[1:])  # compiles the regular expressions of reading flags


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument(
        "family", nargs="*", choices=[*FAMILIES, "flags", []], metavar="FAMILY", help=f"{', '.join(FAMILIES)} or flags"
    )
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--n", type=int, default=200, help="inputs of each family")
    options.add_argument("--first", type=int, default=0, help="number of the first one")
    options.add_argument("--only", type=int, help="one input, whose folder is kept")
    options.add_argument("--jobs", type=int, default=1, help="families at a time")
    options.add_argument("--minutes", type=float, default=600, help="of the clock, of each family")
    options.add_argument("--campaign", action="store_true", help="go on to --n inputs, and record what became of them")
    options.add_argument("--record", type=Path, help=argparse.SUPPRESS)
    given = options.parse_args()
    families = given.family or [*FAMILIES, "flags"]
    if given.only is not None:
        return bool(fuzz(families[0], given.seed, range(given.only, given.only + 1), keep=True).findings)
    if given.record:
        numbers = range(given.first, given.first + given.n)
        write_report(fuzz(families[0], given.seed, numbers, minutes=given.minutes), given.record)
        return 0
    action = continued if given.campaign else tried
    with ThreadPoolExecutor(given.jobs) as pool:
        reports = list(pool.map(lambda family: action(family, given), families))
    return int(any(report.findings for report in reports))


def tried(family: str, given: argparse.Namespace) -> Report:
    """Try the inputs that were asked for."""
    report = in_process(family, given.seed, range(given.first, given.first + given.n), given.minutes)
    summarise(report)
    return report


def continued(family: str, given: argparse.Namespace) -> Report:
    """Try the inputs from the end of the family's record on, a block after another, each recorded once it is done."""
    file = record_of(family, given.seed)
    report = again(read_report(file)) if file.exists() else Report(family, given.seed)
    until = time.monotonic() + 60 * given.minutes
    while report.inputs < given.n and time.monotonic() < until:
        numbers = range(report.inputs, min(report.inputs + BLOCK, given.n))
        block = in_process(family, given.seed, numbers, (until - time.monotonic()) / 60)
        if -1 in block.findings:  # what was tried of the block is not known, and the next one would die as well
            print(f"{family}: {block.findings[-1]}", flush=True)
            break
        report = report.with_next(replace(block, commits={commit(): block.inputs}))
        write_report(report, file)
    write_report(report, file)
    summarise(report)
    return report


def again(report: Report) -> Report:
    """Try what was found once more: what is no finding now was fixed."""
    still = {}
    for k in report.findings:
        still |= in_process(report.family, report.seed, range(k, k + 1), 10).findings
    fixed = {k: said for k, said in report.findings.items() if k not in still}
    return replace(report, findings=still, fixed=report.fixed | fixed)


def record_of(family: str, seed: int) -> Path:
    return CAMPAIGN / f"{re.sub('[^a-z]+', '-', family)}-{seed}.json"


def in_process(family: str, seed: int, numbers: range, minutes: float) -> Report:
    """Fuzz a family in a process of its own: what one imports another has not to carry."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "report.json"
        words = {"seed": seed, "first": numbers.start, "n": len(numbers), "minutes": minutes, "record": file}
        flags = [str(word) for name, value in words.items() for word in (f"--{name}", value)]
        subprocess.run([sys.executable, __file__, family, *flags], check=False)
        return (
            read_report(file)
            if file.exists()
            else Report(family, seed, numbers.start, findings={-1: f"died among {numbers}"})
        )


def summarise(report: Report) -> None:
    kinds = Counter(re.sub(r"^.*?: (?=stat|std|sig|hang|\d|left)", "", found) for found in report.findings.values())
    print(
        f"{report.family}: {report.inputs} inputs, {len(report.findings)} findings, {report.seconds:.0f} s", flush=True
    )
    for kind, count in kinds.most_common():
        print(f"    {count} × {kind}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
