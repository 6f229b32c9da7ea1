"""Plant one-line faults in the package, one at a time, and report those that the tests let live.

    python tools/mutants.py                                  # all of tools/mutants_table.py
    python tools/mutants.py --only schlick --jobs 1          # those whose name matches a regular expression
    python tools/mutants.py --table docs/mutants.md          # go on with the record, and write the table of it

Each fault is applied to a temporary copy of src/ and tests/; the checkout is never written to. The tests that the table
names for it run in that copy with one thread. Outcomes:

    killed      a test failed: the suite notices the fault
    survived    every named test passed: a test is missing
    timeout     the tests did not end in time: the fault was noticed
    crashed     the tests' process was ended by a signal: the fault was noticed
    error       pytest could not run the tests (a wrong name, a module that cannot be imported): the table is wrong

With --table, by one process at a time, each outcome is recorded in tools/campaign/mutants.json as it comes, with the
commit, and a fault that was noticed, with the same edits and tests, is not tried again: the table takes hours, and may
be stopped. Delete the record to begin anew.

First the same tests run on an unmutated copy, where they must pass. Exit status: 0 if every fault was noticed, else 1.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import json
import multiprocessing
import os
import re
import shutil
import signal
import sys
import tempfile
import time
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from commits import commit
from mutants_table import MUTANTS, PACKAGE, Mutant, mutated

ROOT = Path(__file__).resolve().parent.parent
RECORD = ROOT / "tools" / "campaign" / "mutants.json"
COPIED = ("src", "tests", "pyproject.toml")
IGNORED = shutil.ignore_patterns("node_modules", ".hypothesis", "*.egg-info")
SLOW_IMPORTS = (
    "torch", "torch.testing", "numpy", "scipy.stats", "scipy.ndimage", "skimage.measure", "trimesh", "PIL.Image",
    "pytest", "hypothesis.strategies", "hypothesis.internal.conjecture.engine",
)  # fmt: skip
"""Imported once, before the processes of the tests are forked: together they take longer than most of the tests."""

PYTEST = ("-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--tb=line", "--assert=plain")
NOTICED = ("killed", "timeout", "crashed")
WORDS = {0: "survived", 1: "killed"}
"""Of pytest's exit statuses; all others say that the tests did not run."""


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant.

    Attributes:
        word: one of the outcomes above.
        test: the first test that failed, or "".
    """

    mutant: Mutant
    word: str
    test: str
    seconds: float


@dataclass(frozen=True)
class Trial:
    """Tests that run in a process of their own, in a copy of the package."""

    process: BaseProcess
    folder: Path
    start: float

    def status(self) -> int | None:
        """pytest's exit status; None if the process was killed because its time was up.

        What it started goes with it: trainings of several processes may outlive a test that fails.
        """
        late = self.process.is_alive()
        assert self.process.pid is not None
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.kill()
        self.process.join()
        return None if late else self.process.exitcode

    def output(self) -> str:
        """What the tests printed."""
        return (self.folder / "output.txt").read_text(encoding="utf-8", errors="replace")

    @property
    def age(self) -> float:
        """Seconds since the start."""
        return time.monotonic() - self.start


def copy_tree(source: Path, target: Path) -> None:
    """Copy what the tests need from one folder to another."""
    target.mkdir()
    for name in COPIED:
        if (source / name).is_dir():
            shutil.copytree(source / name, target / name, ignore=IGNORED)
        else:
            shutil.copy2(source / name, target / name)


def start_tests(folder: Path, tests: Sequence[str]) -> Trial:
    """Run tests in a forked process, with the package of `folder` and compiled kernels kept beside `folder`."""
    process = multiprocessing.get_context("fork").Process(target=run_tests, args=(folder, tests))
    process.start()
    return Trial(process, folder, time.monotonic())


def run_tests(folder: Path, tests: Sequence[str]) -> None:
    """Run pytest in this process, its output into a file, and end the process with its exit status."""
    os.setsid()  # a group of its own, which is killed as a whole
    output = os.open(folder / "output.txt", os.O_WRONLY | os.O_CREAT)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.chdir(folder)
    sys.dont_write_bytecode = False  # what is compiled in the clean copy is copied with it
    os.environ.update({"PYTHONPATH": str(folder / "src"), "XDG_CACHE_HOME": str(folder.parent / "cache")})
    sys.path.insert(0, str(folder / "src"))
    pytest = importlib.import_module("pytest")
    status = pytest.main([*PYTEST, *tests])
    package = importlib.import_module("unproject").__file__ or ""
    if not Path(package).is_relative_to(folder):
        print(f"mutants: {package} was tested, not the copy; uninstall that package")
        status = -1
    sys.stdout.flush()
    os._exit(int(status) & 0xFF)


def check_clean(clean: Path, mutants: Sequence[Mutant]) -> None:
    """Exit with a message unless all named tests pass without a fault."""
    trial = start_tests(clean, sorted({test for mutant in mutants for test in mutant.tests}))
    trial.process.join()
    if trial.status() != 0:
        sys.exit(f"mutants: the tests fail without any fault; fix them first\n{trial.output()[-4000:]}")


def try_mutants(mutants: Sequence[Mutant], clean: Path, jobs: int, seconds: float) -> Iterator[Outcome]:
    """Apply each mutant to a copy of `clean` and run its tests, `jobs` at a time; in the order in which they end."""
    waiting, running = list(enumerate(mutants)), dict[Trial, Mutant]()
    while waiting or running:
        while waiting and len(running) < jobs:
            number, mutant = waiting.pop(0)
            running[start_mutant(mutant, clean, clean.parent / f"mutant-{number}")] = mutant
        wait([trial.process.sentinel for trial in running], timeout=1)
        for trial in [t for t in running if not t.process.is_alive() or t.age > seconds]:
            yield outcome(running.pop(trial), trial)
            shutil.rmtree(trial.folder)


def start_mutant(mutant: Mutant, clean: Path, folder: Path) -> Trial:
    """Start the tests of a mutant in a new copy of `clean`."""
    copy_tree(clean, folder)
    for file, text in mutated(mutant, folder / PACKAGE).items():
        file.write_text(text, encoding="utf-8")
    return start_tests(folder, mutant.tests)


def outcome(mutant: Mutant, trial: Trial) -> Outcome:
    """Classify a mutant by the tests that ended, or that took too long."""
    seconds, status, output = trial.age, trial.status(), trial.output()
    word = "timeout" if status is None else "crashed" if status < 0 else WORDS.get(status, "error")
    if word == "error":
        print(output[-2000:], file=sys.stderr)
    failed = re.search(r"^FAILED ([^\s\[]+)", output, re.MULTILINE)
    return Outcome(mutant, word, failed[1] if failed else "", seconds)


def recorded() -> dict[str, dict[str, str]]:
    """What is known of the faults as they are in the table now: by name their outcome, test and commit."""
    known = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.exists() else {}
    return {m.name: known[m.name] for m in MUTANTS if known.get(m.name, {}).get("fault") == digest(m)}


def digest(mutant: Mutant) -> str:
    """What changes with the edits and tests of a fault."""
    return f"{zlib.crc32(repr(mutant).encode()):08x}"


def record(found: Outcome, at: str) -> None:
    """Add an outcome to the record, as a whole or not at all."""
    entry = {"fault": digest(found.mutant), "outcome": found.word, "test": found.test, "commit": at}
    text = json.dumps(recorded() | {found.mutant.name: entry}, indent=0, ensure_ascii=False) + "\n"
    unfinished = RECORD.with_suffix(".new")
    unfinished.write_text(text, encoding="utf-8")
    unfinished.replace(RECORD)


def table() -> str:
    """The records in Markdown."""
    known = recorded()
    killed = sum(entry["outcome"] in NOTICED for entry in known.values())
    commits = Counter(entry["commit"] for entry in known.values())
    rows = [
        f"| {m.name} | {', '.join(file_names(m))} | {known[m.name]['outcome']} | "
        f"{'`' + known[m.name]['test'] + '`' if known[m.name]['test'] else ''} |"
        for m in MUTANTS
        if m.name in known
    ]
    tried = ", ".join(f"{name} ({count})" for name, count in commits.most_common())
    head = (
        "# Mutants\n\n"
        "Faults planted one at a time in the package, and the first test that fails. Written by\n"
        "`python tools/mutants.py --table docs/mutants.md`; the faults themselves, old line and new, are in\n"
        f"`tools/mutants_table.py`. The tests notice {killed} of {len(known)}; {len(MUTANTS) - len(known)} more have "
        f"not been tried as they\nare now. Tried at {tried}.\n\n"
    )
    return head + "\n".join(["| fault | file | outcome | by |", "|---|---|---|---|", *rows]) + "\n"


def file_names(mutant: Mutant) -> list[str]:
    """The files that a mutant changes, each once."""
    return list(dict.fromkeys(f"`{edit.file}`" for edit in mutant.edits))


def arguments() -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", default="", metavar="PATTERN", help="a regular expression of names (default: all)")
    parser.add_argument("--jobs", type=int, default=2, help="mutants tried at once (default: 2)")
    parser.add_argument("--seconds", type=float, default=180, help="time limit a mutant (default: 180)")
    parser.add_argument("--table", type=Path, help="go on with the record, and write it to this Markdown file")
    return parser.parse_args()


def main() -> int:
    """Try the mutants, print the outcomes and return the exit status."""
    asked = arguments()
    noticed = {name for name, entry in recorded().items() if asked.table and entry["outcome"] in NOTICED}
    named = [mutant for mutant in MUTANTS if re.search(asked.only, mutant.name)]
    chosen = [mutant for mutant in named if mutant.name not in noticed]
    if not named:
        sys.exit(f"mutants: no name matches {asked.only!r}; leave out --only to try all {len(MUTANTS)}")
    if not chosen:
        asked.table.write_text(table(), encoding="utf-8")
        print(f"mutants: {RECORD} has all {len(named)}; delete it to begin anew")
        return 0
    os.environ.update({"OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"})
    for name in SLOW_IMPORTS:
        importlib.import_module(name)
    start, outcomes, at = time.monotonic(), list[Outcome](), commit("tests")
    with tempfile.TemporaryDirectory(prefix="mutants-") as name:
        clean = Path(name).resolve() / "clean"
        copy_tree(ROOT, clean)
        check_clean(clean, chosen)
        print(f"{len(chosen)} mutants; their tests pass without them in {time.monotonic() - start:.0f} s", flush=True)
        for found in try_mutants(chosen, clean, asked.jobs, asked.seconds):
            outcomes.append(found)
            if asked.table:
                record(found, at)
                asked.table.write_text(table(), encoding="utf-8")
            print(f"{found.word:8}  {found.seconds:4.0f} s  {found.mutant.name}  {found.test}", flush=True)
    unnoticed = [found for found in outcomes if found.word not in NOTICED]
    print(f"{len(outcomes) - len(unnoticed)} of {len(outcomes)} noticed, in {time.monotonic() - start:.0f} s")
    return 1 if unnoticed else 0


if __name__ == "__main__":
    sys.exit(main())
