"""Write docs/campaign.md of what `fuzz.py`, `kills.py`, `conditions.py` and `soak.py` recorded in tools/campaign."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

from fuzz_seeds import CAMPAIGN, FAMILIES, ROOT

INTRODUCTION = """# The campaign

`make campaign` gives every reader damaged and hostile input, and kills commands at random moments; this page is its
last report. It is no part of `make test`, which has a test for each kind of finding (`tests/test_hostile_files.py`,
`tests/test_trust.py`, `tests/test_faults.py`).

## Inputs

Each input is a good file, mutated: bits, lengths, truncation, insertion, repetition; the values of JSON and text;
members, headers, shapes and types of archives, with checksums made to fit again. A command reads it in a process of its
own. It may end with status 0, or with status 2 and one line that begins with `unproject: `, within a minute of the
processor and in 512 MiB and 20 times the input, and may leave nothing half-written; a training that broke down has
begun, and its run stays for its log (two findings of checkpoints ended by this rule, which came after them). All else
is a finding. `refused` counts status 2.
`python tools/fuzz.py FAMILY --seed S --only N` repeats input N.

The campaign takes hours and goes on where its record ends (`tools/campaign`): inputs 0, 1, ... of each family, of which
{asked:,} are asked of each reader. They were tried at {commits};
findings that are fixed are tried again. A first campaign of 4,700 inputs, of before these records, found
some 130 exceptions of twelve kinds, from bombs to two trainings in one folder; each kind has a test since.
"""
READERS = {
    "pictures": ("png", "jpg", "webp", "bmp", "tif", "gif"),
    "idx files": ("idx", "idx.gz"),
    "archives": ("npz", "npz of volumes", "npz of maps"),
    "packed files": ("packed shapes", "pack"),
    "meshes": ("obj", "ply", "stl", "off", "glb", "gltf"),
}
"""Families that one reader reads; each of the others has one of its own."""
KILLS = """
## Kills

SIGKILL at a random moment of a command's time, one to four times; then the same words, or `resume`, to the end.
Checkpoints and logs must be those of a run that was never killed, bit for bit, and so must arrays and meshes. `amid`
counts the kills that hit a command still running. Hidden temporary files, which a kill may leave beside a file that is
then whole or absent, are not compared.
"""
CONDITIONS = """
## Conditions

What a command says where the system is against it (`python tools/conditions.py`), shortened.
"""
SOAK = """
## An hour of training

Each recipe at toy size for an hour, all at once (`python tools/soak.py`): anonymous resident memory, the median of the
first, third, sixth and last tenth of the time. The last may be at most 5 % above the third; the first two are for what
is allocated once: tries, and the first checkpoint with its preview, at step 500.
"""


def main() -> None:
    parts = [INTRODUCTION.format(asked=asked(), commits=commits()), inputs(), KILLS, kills(), CONDITIONS, conditions()]
    parts += [SOAK, soaks()]
    (ROOT / "docs" / "campaign.md").write_text("\n".join(part for part in parts if part), encoding="utf-8")


def asked() -> int:
    """How many inputs a family `make campaign` asks for."""
    found = re.search(r"^INPUTS \?= (\d+)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    assert found
    return int(found[1])


def reports() -> list[dict[str, Any]]:
    found = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(CAMPAIGN.glob("*-[0-9]*.json"))]
    return [report for report in found if report["inputs"]]


def commits() -> str:
    """Commits and how many inputs were tried at them, most first."""
    counts = sum((Counter(report["commits"]) for report in reports()), Counter[str]())
    return ", ".join(f"{name} ({count:,})" for name, count in counts.most_common())


def table(head: str, rows: list[list[Any]]) -> str:
    columns = head.count("|") + 1
    return (
        "\n".join([f"| {head} |", "|---" * columns + "|", *(f"| {' | '.join(map(str, row))} |" for row in rows)]) + "\n"
    )


def stored(name: str) -> Any:
    file = CAMPAIGN / name
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else []


def inputs() -> str:
    families = [*FAMILIES, "flags"]
    alone = {family: (family,) for family in families if not any(family in several for several in READERS.values())}
    rows = []
    for reader, several in (READERS | alone).items():
        of_each = [counts(family) for family in several]
        rows.append([reader, ", ".join(several), *map(sum, zip(*of_each, strict=True))])
    rows.append(["all", "", *map(sum, zip(*(row[2:] for row in rows), strict=True))])
    open_ones = [f"- {r['family']} {k}: {said}" for r in reports() for k, said in r["findings"].items()]
    listed = "\n".join(["", "Open findings:", "", *open_ones, ""]) if open_ones else ""
    return table("reader | families | inputs | refused | findings, fixed | open | seconds", rows) + listed


def counts(family: str) -> list[int]:
    """Inputs, those refused, findings that are fixed and open, and seconds of a family."""
    own = [report for report in reports() if report["family"] == family]
    plain = [sum(report[name] for report in own) for name in ("inputs", "refused")]
    found = [sum(len(report[name]) for report in own) for name in ("fixed", "findings")]
    return [*plain, *found, round(sum(report["seconds"] for report in own))]


def kills() -> str:
    rows = [[t["command"], t["kills"], t["amid"], len(t["lost"]), f"{t['seconds']:.0f}"] for t in stored("kills.json")]
    return table("command | kills | amid | lost | seconds", rows)


def conditions() -> str:
    found = stored("conditions.json")
    return table(
        "condition | status | said |".rstrip(" |"),
        [[c["name"].replace("|", "\\|"), c["status"], said(c)] for c in found],
    )


def soaks() -> str:
    rows = []
    for one in stored("soak.json"):
        held = one["megabytes"]
        shown = [f"{held[k]:.0f}" if held[k] else "ended" for k in (0, 2, 5, 9)]
        why = one["said"].removeprefix("unproject: ").partition(":")[0]
        ended = f"{one['commit']}, {why}" if why else one["commit"]
        rows.append([one["recipe"], one["steps"], *shown, f"{held[9] / held[2] - 1:+.1%}" if held[9] else "", ended])
    return table("recipe | steps | first tenth, MB | third | sixth | last | grown since the third | commit", rows)


def said(condition: dict[str, Any]) -> str:
    """The line that matters: the mistake, or the first."""
    lines = [line for line in condition["said"].splitlines() if line.strip()]
    chosen = [line for line in lines if line.startswith("unproject: ")] or lines[:1] or ["nothing"]
    text = re.sub(r"x{20,}", "xx…", re.sub(rf"{re.escape(str(Path.home()))}\S*", "…", chosen[0]))
    return f"`{text[:140]}`".replace("|", "\\|")


if __name__ == "__main__":
    main()
