"""Write docs/campaign.md of what `fuzz.py`, `kills.py` and `conditions.py` stored in build/campaign."""

from __future__ import annotations

import json
import re
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
processor and in 512 MiB and 20 times the input, and may leave nothing half-written. All else is a finding. `refused`
<<<<<<< HEAD
counts status 2.
`python tools/fuzz.py FAMILY --seed S --only N` repeats input N.
=======
counts status 2. `python tools/fuzz.py FAMILY --seed S --only N` repeats input N.
>>>>>>> f762ec0f33dd127bfa7e104184271b0d4031e678
"""
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


def main() -> None:
    parts = [INTRODUCTION, inputs(), KILLS, kills(), CONDITIONS, conditions()]
    (ROOT / "docs" / "campaign.md").write_text("\n".join(part for part in parts if part), encoding="utf-8")


def table(head: str, rows: list[list[Any]]) -> str:
    columns = head.count("|") + 1
    return (
        "\n".join([f"| {head} |", "|---" * columns + "|", *(f"| {' | '.join(map(str, row))} |" for row in rows)]) + "\n"
    )


def stored(name: str) -> Any:
    file = CAMPAIGN / name
    return json.loads(file.read_text(encoding="utf-8")) if file.exists() else []


def inputs() -> str:
    reports = [json.loads(file.read_text(encoding="utf-8")) for file in sorted(CAMPAIGN.glob("*-*-*.json"))]
    rows = []
    for family in [*FAMILIES, "flags"]:
        own = [report for report in reports if report["family"] == family]
        sums = [sum(report[name] for report in own) for name in ("inputs", "refused", "seconds")]
        rows.append([family, sums[0], sums[1], sum(len(report["findings"]) for report in own), f"{sums[2]:.0f}"])
    rows.append(["all", *(sum(int(row[k]) for row in rows) for k in range(1, 5))])
    return table("family | inputs | refused | findings | seconds", rows)


def kills() -> str:
    rows = [[t["command"], t["kills"], t["amid"], len(t["lost"]), f"{t['seconds']:.0f}"] for t in stored("kills.json")]
    return table("command | kills | amid | lost | seconds", rows)


def conditions() -> str:
    found = stored("conditions.json")
    return table(
        "condition | status | said |".rstrip(" |"),
        [[c["name"].replace("|", "\\|"), c["status"], said(c)] for c in found],
    )


def said(condition: dict[str, Any]) -> str:
    """The line that matters: the mistake, or the last."""
    lines = [line for line in condition["said"].splitlines() if line.strip()]
    chosen = [line for line in lines if line.startswith("unproject: ")] or lines[:1] or ["nothing"]
    text = re.sub(r"x{20,}", "xx…", re.sub(rf"{re.escape(str(Path.home()))}\S*", "…", chosen[0]))
    return f"`{text[:140]}`".replace("|", "\\|")


if __name__ == "__main__":
    main()
