"""Collections: the training pictures of a run by the view that each was assigned, how sure that is, and corrections.

Corrected views are stored as views.csv in the run, in the form that `unproject train` reads beside pictures.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .._files import write_text
from .._types import UserError
from ..assignment import AssignmentState
from ..projections.priors import Prior, Uniform, factors_of
from ..report.pictures import picture_of
from ..report.sections import views_of
from ..training.run_directory import read_recipe
from ..training.seen import sheet_as_seen
from .answers import Answer, Request, of_json
from .downloads import attachment
from .state import State

VIEWS = "views.csv"
PAGE, CELL = 60, 72
"""Pictures sent at once, and pixels of each."""


@dataclass(frozen=True, eq=False)
class Sorted:
    """The pictures of one panel.

    Attributes:
        state: the assignment.
        names: of all pictures, those held out last.
        labels: of the views.
        views: (N + M,) the view of each picture.
        sure: (N + M,) the probability of that view; None if views are known.
    """

    state: AssignmentState
    names: tuple[str, ...]
    labels: list[str]
    views: Tensor
    sure: Tensor | None

    def picture(self, row: int) -> Tensor:
        """Return a picture (1, ...) as training gets it."""
        panel = self.state.panel
        count = len(panel)
        rows = torch.tensor([row if row < count else row - count])
        return panel.batch(rows) if row < count or panel.held_out is None else panel.held_out.batch(rows)

    def angles(self) -> list[dict[str, float]] | None:
        """Return the middle of each view in degrees, by the columns of views.csv; None if views have no azimuth."""
        found = [_middle(o.prior) for o in self.state.panel.observations]
        one = len(self.state.panel.collections) == 1 and len(found) > 1
        return found if one and all("azimuth" in angles for angles in found) else None


def _middle(prior: Prior) -> dict[str, float]:
    named = {f.name: (f.low + f.high) / 2 for f in factors_of(prior) if isinstance(f, Uniform)}
    found = {name: math.degrees(named[name]) for name in ("azimuth", "elevation") if name in named}
    return found | {"azimuth": found["azimuth"] % 360} if "azimuth" in found else found


def _sorted(state: State, name: str) -> list[Sorted]:
    """Return the panels of a run; its data are read, or made, again."""
    run = state.opened(name)
    resolved = read_recipe(run.path)["resolved"]
    with torch.no_grad():
        states = run.assignments()
        return [_panel(one, k, resolved.get("panels")) for k, one in enumerate(states)]


def _panel(state: AssignmentState, k: int, described: Any) -> Sorted:
    panel = state.panel
    names = [name for part in panel.collections for name in part.names]
    held_out = [] if panel.held_out is None else list(panel.held_out.names)
    p = state.view_probabilities()
    labels, _ = views_of(described, k, len(panel.observations))
    if len(set(labels)) < len(labels) or labels == [str(i) for i in range(len(labels))]:
        labels = [o.name for o in panel.observations]
    if p is None:
        return Sorted(state, tuple(names), labels, state.views.long(), None)
    views = torch.cat([state.views.long(), p[len(names) :].argmax(1)])
    return Sorted(state, (*names, *held_out), labels, views, p[torch.arange(len(views)), views])


def _of(state: State, request: Request) -> tuple[list[Sorted], Sorted]:
    name = request.text("run")
    version = state.version(state.opened(name))
    panels = state.kept(("collections", name, version), lambda: _sorted(state, name), 2)
    return panels, panels[request.whole("panel", 0, 0, len(panels) - 1)]


def show_collection(state: State, request: Request) -> Answer:
    """Answer with the panels of a run, how many pictures each view has, what was skipped and why."""
    panels, chosen = state.compute(lambda: _of(state, request))
    corrected = _corrected(state, request.text("run"), chosen)
    views = _with(chosen, corrected)
    skipped = [list(one) for part in chosen.state.panel.collections for one in part.skipped]
    return of_json(
        {
            "panels": [_title(one) for one in panels],
            "labels": chosen.labels,
            "counts": torch.bincount(views, minlength=len(chosen.labels)).tolist(),
            "pictures": len(chosen.names),
            "known": chosen.sure is None,
            "correctable": chosen.angles() is not None,
            "corrected": len(corrected),
            "skipped": skipped,
        }
    )


def _title(panel: Sorted) -> str:
    names = [o.name for o in panel.state.panel.observations]
    return names[0] if len(names) == 1 else f"{names[0]} … {names[-1]}"


def show_pictures(state: State, request: Request) -> Answer:
    """Answer with the pictures of one view, or of all, the least sure first."""

    def page() -> dict[str, Any]:
        _, chosen = _of(state, request)
        corrected = _corrected(state, request.text("run"), chosen)
        views = _with(chosen, corrected)
        wanted = request.whole("view", -1, -1, len(chosen.labels) - 1)
        rows = torch.arange(len(views)) if wanted < 0 else (views == wanted).nonzero()[:, 0]
        if chosen.sure is not None:
            rows = rows[chosen.sure[rows].argsort(stable=True)]
        first = PAGE * request.whole("page", 0, 0, 10**6)
        found = [_entry(chosen, row, int(views[row]), corrected) for row in rows[first : first + PAGE].tolist()]
        return {"total": len(rows), "page": PAGE, "pictures": found}

    return of_json(state.compute(page))


def _entry(chosen: Sorted, row: int, view: int, corrected: dict[str, int]) -> dict[str, Any]:
    shown = sheet_as_seen(chosen.state.panel.projection, chosen.picture(row), 1, CELL)
    name = chosen.names[row]
    return {
        "name": name,
        "view": view,
        "sure": None if chosen.sure is None else round(float(chosen.sure[row]), 3),
        "corrected": name in corrected,
        "picture": picture_of(shown, name, CELL).uri,
    }


def _with(chosen: Sorted, corrected: dict[str, int]) -> Tensor:
    """Return the views (N + M,), those that were corrected among them."""
    views = chosen.views.clone()
    for row, name in enumerate(chosen.names):
        if name in corrected:
            views[row] = corrected[name]
    return views


def _corrected(state: State, name: str, chosen: Sorted) -> dict[str, int]:
    """Return picture → view of views.csv where it differs from what was assigned; rows that do not fit are left out."""
    file, angles = state.folder.run(name) / VIEWS, chosen.angles()
    if angles is None or not file.is_file():
        return {}
    columns = list(angles[0])
    rows = {name: row for row, name in enumerate(chosen.names)}
    found = {}
    for line in csv.DictReader(io.StringIO(file.read_text(encoding="utf-8", errors="replace"))):
        try:
            given = {column: float(line[column]) for column in columns}
            row = rows[line["file"]]
        except (KeyError, TypeError, ValueError):
            continue
        view = min(range(len(angles)), key=lambda k: sum(_apart(angles[k][c], given[c]) ** 2 for c in columns))
        if view != int(chosen.views[row]):
            found[line["file"]] = view
    return found


def _apart(a: float, b: float) -> float:
    return abs((a - b + 180) % 360 - 180)


def correct(state: State, request: Request) -> Answer:
    """Store the view of a picture: views.csv then holds the views of all pictures, the corrected ones among them."""
    given = request.json()
    asked = Request({"run": str(given.get("run", "")), "panel": str(given.get("panel", 0))})
    _, chosen = state.compute(lambda: _of(state, asked))
    angles, name, view = chosen.angles(), given.get("name"), given.get("view")
    if angles is None:
        raise UserError("the views of these pictures have no azimuth; there is nothing to correct")
    if name not in chosen.names or type(view) is not int or not 0 <= view < len(angles):
        raise UserError(f"{str(name)[:80]}: give a picture of the run and a view from 0 to {len(angles) - 1}")
    with state.writing:
        corrected = {**_corrected(state, asked.text("run"), chosen), str(name): view}
        file = state.folder.run(asked.text("run")) / VIEWS
        _write(file, _table(chosen, _with(chosen, corrected), angles) + _others(file, chosen))
    return of_json({"file": str(file), "corrected": len(corrected)})


def download_views(state: State, request: Request) -> Answer:
    """Answer with the views of all pictures as views.csv."""
    _, chosen = state.compute(lambda: _of(state, request))
    angles = chosen.angles()
    if angles is None:
        raise UserError("the views of these pictures have no azimuth; there is no views.csv of them")
    views = _with(chosen, _corrected(state, request.text("run"), chosen))
    return attachment(_table(chosen, views, angles).encode(), VIEWS)


def _write(file: Path, table: str) -> None:
    write_text(file, table)


def _others(file: Path, chosen: Sorted) -> str:
    """Return the lines of views.csv that are of other panels' pictures."""
    if not file.exists():
        return ""
    own, text = {"file", *chosen.names}, file.read_text(encoding="utf-8", errors="replace")
    rows = [row for row in csv.reader(io.StringIO(text)) if row and row[0] not in own]
    return _csv(rows)


def _csv(rows: Iterable[Sequence[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _table(chosen: Sorted, views: Tensor, angles: list[dict[str, float]]) -> str:
    """Return views.csv of the pictures; mirror images, which are no files, are left out."""
    rows = [
        [name, *(f"{angle:g}" for angle in angles[view].values())]
        for name, view in zip(chosen.names, views.tolist(), strict=True)
        if not name.endswith(" flipped")
    ]
    return _csv([["file", *angles[0]], *rows])
