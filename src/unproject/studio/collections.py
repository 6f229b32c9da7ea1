"""Collections: the training pictures of a run by the view that each was assigned, how sure that is, and corrections.

The views are known, or predicted, or there are none: where all samples are seen from anywhere, no picture has one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import torch
from torch import Tensor

from .._types import UserError
from ..assignment import AssignmentState
from ..data.splitting import FLIPPED
from ..report.pictures import picture_of
from ..report.sections import views_of
from ..training.run_directory import read_recipe
from ..training.seen import sheet_as_seen
from .answers import Answer, Request, of_json
from .corrections import VIEWS, corrections_of, middle, outdated, store, table
from .downloads import attachment
from .state import State

Known = Literal["known", "predicted", "none"]
PAGE, CELL = 60, 72
"""Pictures sent at once, and pixels of each."""


@dataclass(frozen=True, eq=False)
class Sorted:
    """The pictures of one panel.

    Attributes:
        state: the assignment.
        known: how the views came about.
        rows: of the pictures, those held out last; mirror images, which training made, are left out.
        names: of the pictures.
        labels: of the views; none if there are no views.
        views: (N,) the view of each picture; -1 if there are none.
        sure: (N,) the probability of that view, if it was predicted.
    """

    state: AssignmentState
    known: Known
    rows: tuple[int, ...]
    names: tuple[str, ...]
    labels: list[str]
    views: Tensor
    sure: Tensor | None

    def picture(self, row: int) -> Tensor:
        """Return a picture (1, ...) as training gets it."""
        panel, k = self.state.panel, self.rows[row]
        count = len(panel)
        rows = torch.tensor([k if k < count else k - count])
        return panel.batch(rows) if k < count or panel.held_out is None else panel.held_out.batch(rows)

    def angles(self) -> list[dict[str, float]] | None:
        """Return the middle of each view in degrees, by the columns of views.csv; None if views have no azimuth."""
        found = [middle(o.prior) for o in self.state.panel.observations]
        one = len(self.state.panel.collections) == 1 and len(found) > 1
        return found if one and self.labels and all("azimuth" in angles for angles in found) else None


def _sorted(state: State, name: str) -> list[Sorted]:
    """Return the panels of a run; its data are read, or made, again."""
    run = state.opened(name)
    resolved = read_recipe(run.path)["resolved"]
    with torch.no_grad():
        states = run.assignments()
        return [_panel(one, k, resolved.get("panels")) for k, one in enumerate(states)]


def _panel(state: AssignmentState, k: int, described: Any) -> Sorted:
    panel = state.panel
    names = [name for part in (*panel.collections, panel.held_out) if part is not None for name in part.names]
    kept = [row for row, name in enumerate(names) if not name.endswith(FLIPPED)]
    listed, rows = tuple(names[row] for row in kept), torch.tensor(kept)
    p = state.view_probabilities()
    if p is None and not state.fixes_gauge:
        return Sorted(state, "none", tuple(kept), listed, [], torch.full((len(kept),), -1), None)
    labels, _ = views_of(described, k, len(panel.observations))
    if len(set(labels)) < len(labels) or labels == [str(i) for i in range(len(labels))]:
        labels = [o.name for o in panel.observations]
    held_out = (
        [] if panel.held_out is None else [state.held_out_heads.long() if p is None else p[len(panel) :].argmax(1)]
    )
    views = torch.cat([state.views.long(), *held_out])[rows]
    known = "known" if p is None else "predicted"
    return Sorted(state, known, tuple(kept), listed, labels, views, None if p is None else p[rows, views])


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
            "counts": [int((views == k).sum()) for k in range(len(chosen.labels))],
            "pictures": len(chosen.names),
            "views": chosen.known,
            "correctable": chosen.angles() is not None,
            "corrected": len(corrected),
            "outdated": chosen.angles() is not None and outdated(state.folder.run(request.text("run"))),
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
    """Return the views (N,), those that were corrected among them."""
    views = chosen.views.clone()
    for row, name in enumerate(chosen.names):
        if name in corrected:
            views[row] = corrected[name]
    return views


def _corrected(state: State, name: str, chosen: Sorted) -> dict[str, int]:
    angles, assigned = chosen.angles(), dict(zip(chosen.names, chosen.views.tolist(), strict=True))
    return {} if angles is None else corrections_of(state.folder.run(name), angles, assigned)


def correct(state: State, request: Request) -> Answer:
    """Store the view of a picture; it stays, whatever is predicted of it later."""
    given = request.json()
    asked = Request({"run": str(given.get("run", "")), "panel": str(given.get("panel", 0))})
    _, chosen = state.compute(lambda: _of(state, asked))
    angles, name, view = chosen.angles(), given.get("name"), given.get("view")
    if angles is None:
        raise UserError("these pictures have no views with an azimuth; there is nothing to correct")
    if name not in chosen.names or type(view) is not int or not 0 <= view < len(angles):
        raise UserError(f"{str(name)[:80]}: give a picture of the run and a view from 0 to {len(angles) - 1}")
    with state.writing:
        corrected = {**_corrected(state, asked.text("run"), chosen), str(name): view}
        store(state.folder.run(asked.text("run")), corrected, angles, chosen.names)
    return of_json({"corrected": len(corrected)})


def download_views(state: State, request: Request) -> Answer:
    """Answer with the views of all pictures, as they are now and as they were corrected, as views.csv."""
    _, chosen = state.compute(lambda: _of(state, request))
    angles = chosen.angles()
    if angles is None:
        raise UserError("these pictures have no views with an azimuth; there is no views.csv of them")
    views = _with(chosen, _corrected(state, request.text("run"), chosen))
    return attachment(table(dict(zip(chosen.names, views.tolist(), strict=True)), angles).encode(), VIEWS)
