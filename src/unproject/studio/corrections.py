"""Corrections: the views that a person gave pictures of a run, in its corrections.csv, and views.csv of all pictures.

Both have the form that `unproject train` reads beside pictures. A run holds corrections alone: the views of the other
pictures change as it trains on, so that views.csv is made of both when it is asked for.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from .._files import write_text
from ..projections.priors import Prior, Uniform, factors_of
from ..training.checkpoint import list_checkpoints

CORRECTIONS, VIEWS = "corrections.csv", "views.csv"

Angles = Sequence[Mapping[str, float]]
"""The middle of each view in degrees, by the columns of the table."""


def middle(prior: Prior) -> dict[str, float]:
    """Return the middle of a view in degrees: its azimuth from 0 to 360, and its elevation if it has one."""
    named = {f.name: (f.low + f.high) / 2 for f in factors_of(prior) if isinstance(f, Uniform)}
    found = {name: math.degrees(named[name]) for name in ("azimuth", "elevation") if name in named}
    return found | {"azimuth": found["azimuth"] % 360} if "azimuth" in found else found


def corrections_of(run: Path, angles: Angles, assigned: Mapping[str, int]) -> dict[str, int]:
    """Return picture → view as corrected; rows that fit no picture are left out.

    A version before kept views.csv of all pictures in the run. What differs there from the views that were assigned is
    a correction, if no weights have been written since: later ones assign other views.

    Args:
        assigned: picture → view.
    """
    if (run / CORRECTIONS).is_file():
        return {name: view for name, view in _rows(run / CORRECTIONS, angles) if name in assigned}
    file = run / VIEWS
    if not file.is_file() or outdated(run):
        return {}
    return {name: view for name, view in _rows(file, angles) if assigned.get(name, view) != view}


def outdated(run: Path) -> bool:
    """Whether a views.csv of a version before is in a run that was trained since: what was corrected is not known."""
    if (run / CORRECTIONS).is_file() or not (run / VIEWS).is_file():
        return False
    written = [file.stat().st_mtime_ns for file in list_checkpoints(run / "checkpoints")]
    return max(written, default=0) > (run / VIEWS).stat().st_mtime_ns


def _rows(file: Path, angles: Angles) -> Iterable[tuple[str, int]]:
    for line in csv.DictReader(io.StringIO(file.read_text(encoding="utf-8", errors="replace"))):
        try:
            name, given = line["file"], {column: float(line[column]) for column in angles[0]}
        except (KeyError, TypeError, ValueError):
            continue
        yield name, min(range(len(angles)), key=lambda k: sum(_apart(angles[k][c], given[c]) ** 2 for c in given))


def _apart(a: float, b: float) -> float:
    return abs((a - b + 180) % 360 - 180)


def store(run: Path, corrected: Mapping[str, int], angles: Angles, names: Sequence[str]) -> None:
    """Write corrections of the pictures of one panel, which has these names; those of others stay."""
    write_text(run / CORRECTIONS, table(corrected, angles) + _others(run / CORRECTIONS, names))


def _others(file: Path, names: Sequence[str]) -> str:
    if not file.exists():
        return ""
    own, text = {"file", *names}, file.read_text(encoding="utf-8", errors="replace")
    return _csv([row for row in csv.reader(io.StringIO(text)) if row and row[0] not in own])


def table(views: Mapping[str, int], angles: Angles) -> str:
    """Return the table of pictures → views.

    Examples:
        >>> table({"a.png": 1}, [{"azimuth": 0.0}, {"azimuth": 22.5}])
        'file,azimuth\\na.png,22.5\\n'
    """
    return _csv([["file", *angles[0]], *([name, *(f"{a:g}" for a in angles[k].values())] for name, k in views.items())])


def _csv(rows: Iterable[Sequence[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
