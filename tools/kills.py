"""Kill commands at random moments, and see that nothing is lost and nothing broken is taken for whole.

    python tools/kills.py --n 100              # kills, spread over the commands
    python tools/kills.py --only train --n 20
    python tools/kills.py --campaign --n 1000   # goes on to so many, and records them in tools/campaign

Each command is run once to its end. Then it is run again and again in a forked child that gets SIGKILL at a random
moment of the time that it took; afterwards the same words (`resume`, where there is a run already) must bring about what
the first run did: checkpoints and log equal bit for bit but for seconds, arrays and files equal byte for byte. What
lies there between is looked at by the command that would read it. Exit status: 1 if anything was lost.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import sys
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"  # threads do not survive a fork

import numpy as np  # noqa: E402
from commits import commit  # noqa: E402
from fuzz import Input as Words  # noqa: E402
from fuzz import preload  # noqa: E402
from fuzz_seeds import CAMPAIGN, ROOT, TOY, npz, picture, read, volumes, write  # noqa: E402

sys.path.insert(0, str(ROOT / "tests" / "training"))
MASKS = 60
PATIENCE = 60.0
"""Seconds that the processes of a killed command have to save and leave."""


@dataclass
class Command:
    """What is killed.

    Attributes:
        words: of the command.
        again: words that go on with what it left, given whether there is a run.
        compared: says what differs between two folders in which it has come to its end.
        whole: says what is wrong with what a killed command left.
    """

    words: str
    again: Callable[[Path], str]
    compared: Callable[[Path, Path], list[str]]
    whole: Callable[[Path], list[str]]


@dataclass
class Tally:
    """What became of the kills of a command.

    Attributes:
        commits: at which commit how many of them were made.
    """

    command: str
    kills: int = 0
    amid: int = 0
    seconds: float = 0.0
    lost: list[str] = field(default_factory=list)
    commits: dict[str, int] = field(default_factory=dict)


def begin(words: str, folder: Path) -> int:
    """Start a command in a forked child."""
    sys.stdout.flush()
    child = os.fork()
    if child:
        return child
    status = 99
    try:
        os.chdir(folder)
        for number in (1, 2):
            os.dup2(os.open(f"said-{number}", os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        from unproject.cli import main

        status = main(words.split())
    finally:
        with contextlib.suppress(BaseException):
            sys.stderr.flush()
        os._exit(status)


def finish(words: str, folder: Path) -> int:
    return os.waitstatus_to_exitcode(os.waitpid(begin(words, folder), 0)[1])


def kill(words: str, folder: Path, after: float) -> bool:
    """Kill a command after so many seconds; whether it was still running."""
    child = begin(words, folder)
    time.sleep(after)
    os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) < 0


def left_alive(folder: Path) -> list[str]:
    """Processes that a killed command had started and that did not end soon after it."""
    until = time.monotonic() + PATIENCE
    while (names := at_work_in(folder)) and time.monotonic() < until:
        time.sleep(0.05)
    return names


def at_work_in(folder: Path) -> list[str]:
    names = []
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):  # it ended meanwhile
            if Path(os.readlink(process / "cwd")) == folder.resolve():
                names.append((process / "cmdline").read_text().replace("\0", " ")[:100])
    return names


def resumed(words: str, further: str = "") -> Callable[[Path], str]:
    """`train` where there is no run yet, else `resume`."""
    resume = f"resume run --trust --quiet --threads 1{further}"
    return lambda folder: resume if (folder / "run" / "recipe.json").exists() else words


def runs_differ(one: Path, other: Path) -> list[str]:
    from comparing import differences

    return differences(one / "run", other / "run")


def run_is_whole(folder: Path) -> list[str]:
    """Every checkpoint there is can be read, and so can recipe.json and the pictures."""
    from PIL import Image

    from unproject.training import checkpoint
    from unproject.training.run_directory import read_recipe

    wrong = []
    run = folder / "run"
    with collecting(wrong):
        if (run / "recipe.json").exists():
            read_recipe(run)
    for file in checkpoint.list_checkpoints(run / "checkpoints"):
        with collecting(wrong):
            checkpoint.load(file)
    for file in (run / "samples").glob("step-*.png"):
        with collecting(wrong):
            Image.open(file).load()
    return wrong


@contextlib.contextmanager
def collecting(wrong: list[str]) -> object:  # pyright: ignore
    try:
        yield
    except Exception as error:
        wrong.append(f"{type(error).__name__}: {error}")


def same_files(*names: str) -> Callable[[Path, Path], list[str]]:
    """Compare files, or all files of folders, byte for byte."""

    def compared(one: Path, other: Path) -> list[str]:
        trees = [{k: v for k, v in read(f).items() if k.startswith(names) and "/." not in k} for f in (one, other)]
        return sorted(k for k in trees[0].keys() | trees[1].keys() if trees[0].get(k) != trees[1].get(k))

    return compared


def arrays_differ(name: str) -> Callable[[Path, Path], list[str]]:
    """Compare the arrays of two .npz files: the archives hold times."""

    def compared(one: Path, other: Path) -> list[str]:
        with np.load(one / name) as ours, np.load(other / name) as theirs:
            same = ours.files == theirs.files
            return [] if same and all(np.array_equal(ours[k], theirs[k]) for k in ours.files) else [name]

    return compared


def whole_or_absent(name: str) -> Callable[[Path], list[str]]:
    """What stands under the final name can be read to its end."""

    def check(folder: Path) -> list[str]:
        wrong: list[str] = []
        for file in [folder / name] if "*" not in name else folder.glob(name.replace("*", "[!.]*")):
            with collecting(wrong):
                if file.suffix == ".npz" and file.exists():
                    with np.load(file) as arrays:
                        [arrays[key] for key in arrays.files]
                elif file.suffix == ".glb" and file.exists():
                    import trimesh

                    trimesh.load(file)
        return wrong

    return check


def scores_of(folder: Path) -> dict[str, object]:
    """The scores of the arms of a reproduction."""
    results = (folder / "reproduction" / "cpu" / "results").glob("*.json")
    return {file.name: json.loads(file.read_text(encoding="utf-8"))["scores"] for file in results}


def scores_differ(one: Path, other: Path) -> list[str]:
    ours, theirs = scores_of(one), scores_of(other)
    different = sorted(name for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name))
    reports = [f"toy{suffix}" for suffix in (".md", ".html", ".webp")]
    return different + [name for name in reports if not (other / "reproduction" / "cpu" / name).exists()]


def results_are_whole(folder: Path) -> list[str]:
    wrong: list[str] = []
    with collecting(wrong):
        scores_of(folder)
    return wrong


def toy_figure() -> None:
    """Add a figure of two arms of a few steps, for `reproduce toy`; only this process and its forks have it."""
    from unproject import domains, reproduce
    from unproject.reproduce import running

    arms = tuple(
        reproduce.Arm(f"toy-{name}", "digits", "digits", name, {} if name == "known" else {"views": name})
        for name in ("known", "single")
    )
    claims = (reproduce.Claim("known is nearer", "toy-known", "toy-single", ("frechet",)),)
    reproduce.FIGURES["toy"] = reproduce.Figure(
        name="toy", title="Digits", claim="Digits are learned.", paper_says="Nothing.", arms=arms, claims=claims
    )
    small = {"size": 16, "steps": 30, "channels": 8, "batch": 4, "checkpoint_every": 5}
    running.flags_of = lambda arm, budget: small | dict(arm.flags)
    domains.Images.scored = 64


def repeated(words: str) -> Callable[[Path], str]:
    return lambda folder: words


TRAIN = f"train {TOY}:toy --steps 30 --checkpoint-every 5 --quiet --threads 1 --out run"
SAMPLE, PACK = "sample run --trust --n 200 --out x.npz", "data pack masks --out pack.npz --size 24"
EXPORT, REPORT = "export volumes.npz --n 6 --out meshes", "report run --trust --out x.html --threads 1"
EVALUATE = "evaluate run --trust --n 16 --json --threads 1"
TWO = f"{TRAIN} --views known --processes 2"
REPRODUCE = "reproduce toy --parallel 2 --threads 1 --seeds 1"
COMMANDS = {
    "train": Command(f"{TRAIN} --views known", resumed(f"{TRAIN} --views known"), runs_differ, run_is_whole),
    "train, views predicted": Command(TRAIN, resumed(TRAIN), runs_differ, run_is_whole),
    "resume": Command("resume run --trust --quiet --threads 1 --steps 60", lambda folder: "resume run --trust --quiet --threads 1 --steps 60", runs_differ, run_is_whole),  # noqa: E501
    "pack": Command(PACK, repeated(PACK), arrays_differ("pack.npz"), whole_or_absent("pack.npz")),
    "sample": Command(SAMPLE, repeated(SAMPLE), arrays_differ("x.npz"), whole_or_absent("x.npz")),
    "export": Command(EXPORT, repeated(EXPORT), same_files("meshes"), whole_or_absent("meshes/*.glb")),
    "evaluate": Command(EVALUATE, repeated(EVALUATE), same_files("said-1", "run/checkpoints"), run_is_whole),
    "report": Command(REPORT, repeated(REPORT), lambda one, other: [] if (other / "x.html").exists() else ["x.html"], run_is_whole),
    "train, two processes": Command(TWO, resumed(TWO, " --processes 2"), runs_differ, run_is_whole),
    "reproduce": Command(REPRODUCE, repeated(REPRODUCE), scores_differ, results_are_whole),
}  # fmt: skip
NEEDS_RUN = ("resume", "sample", "evaluate", "report")


def run_of(top: Path) -> Path:
    """A finished run, of which each command gets a copy."""
    if not (top / "whole").exists():
        (top / "whole").mkdir()
        assert finish(f"{TRAIN} --views known", top / "whole") == 0
    return top / "whole" / "run"


def prepared(name: str, top: Path) -> Path:
    """A folder with what the command needs."""
    folder = Path(tempfile.mkdtemp(dir=top))
    if name in NEEDS_RUN:
        shutil.copytree(run_of(top), folder / "run")
    if name == "pack":
        write({f"masks/{k:03d}.png": picture("png", side=256) for k in range(MASKS)}, folder)
    if name == "export":
        write({"volumes.npz": npz(volume=volumes(6).repeat(4, 1).repeat(4, 2).repeat(4, 3))}, folder)
    return folder


def killed(name: str, command: Command, top: Path, tally: Tally, kills: int, seed: int) -> Iterator[Tally]:
    """Go on to so many kills of a command, in runs of one to four, of each of which the tally is yielded."""
    if tally.kills >= kills:
        return
    reference, began = prepared(name, top), time.monotonic()
    assert finish(command.words, reference) == 0, (reference / "said-2").read_text()
    took, now = time.monotonic() - began, commit()
    while tally.kills < kills:
        began, before = time.monotonic(), tally.kills
        rng = np.random.default_rng([seed, zlib.crc32(name.encode()), tally.kills])
        folder, words = prepared(name, top), command.words
        for _ in range(int(rng.integers(1, 5))):
            tally.kills += 1
            tally.amid += kill(words, folder, rng.uniform(0, took))
            tally.lost += [f"lives on: {name}" for name in left_alive(folder)]
            words = command.again(folder)
            tally.lost += command.whole(folder)
        status = finish(words, folder)
        tally.lost += [f"status {status}: {(folder / 'said-2').read_text()[:200]}"] if status else []
        tally.lost += command.compared(reference, folder) if not status else []
        tally.lost += [
            f"left: {path.name}" for path in folder.rglob("*.tmp*") if "run" in path.parts and "train" in name
        ]
        shutil.rmtree(folder)
        tally.seconds = round(tally.seconds + time.monotonic() - began, 1)
        tally.commits[now] = tally.commits.get(now, 0) + tally.kills - before
        yield tally


def main() -> int:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--n", type=int, default=100, help="kills")
    options.add_argument("--only", choices=COMMANDS, help="of one command alone")
    options.add_argument("--seed", type=int, default=0)
    options.add_argument("--minutes", type=float, default=600, help="of the clock, of each command")
    options.add_argument("--campaign", action="store_true", help="go on with what is recorded in tools/campaign")
    given = options.parse_args()
    top = Path(tempfile.mkdtemp(prefix="kills-"))
    toy_figure()
    preload(
        [Words(f"{TRAIN} --views known".split(), {}), Words(["report", "run", "--trust", "--out", "x.html"], {})], top
    )
    record = CAMPAIGN / "kills.json"
    tallies = {name: Tally(name) for name in COMMANDS}
    if given.campaign and record.exists():
        tallies |= {t["command"]: Tally(**t) for t in json.loads(record.read_text(encoding="utf-8"))}
    chosen = [name for name in COMMANDS if given.only in (None, name)]
    for name in chosen:
        until = time.monotonic() + 60 * given.minutes
        for _ in killed(name, COMMANDS[name], top, tallies[name], -(-given.n // len(chosen)), given.seed):
            if given.campaign:
                write_tallies(record, tallies)
            if time.monotonic() > until:
                break
        summarise(tallies[name])
    shutil.rmtree(top)
    return int(any(tally.lost for tally in tallies.values()))


def write_tallies(record: Path, tallies: dict[str, Tally]) -> None:
    """Write the record as a whole, or not at all."""
    record.parent.mkdir(parents=True, exist_ok=True)
    unfinished = record.with_suffix(".new")
    text = json.dumps([asdict(tally) for tally in tallies.values()], indent=1)
    unfinished.write_text(text + "\n", encoding="utf-8")
    unfinished.replace(record)


def summarise(tally: Tally) -> None:
    print(
        f"{tally.command}: {tally.kills} kills, {tally.amid} amid, {len(tally.lost)} lost, {tally.seconds:.0f} s",
        flush=True,
    )
    for what in tally.lost[:10]:
        print(f"    {what}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
