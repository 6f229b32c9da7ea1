"""Fits: a picture is dropped, one after another is explained, and what was found can be turned and downloaded."""

from __future__ import annotations

import secrets
from pathlib import Path
from typing import Any

from torch import Tensor

from .. import export
from .._types import UserError
from ..data.readers.pictures import SUFFIXES
from ..inversion import DOUBTFUL, Fit
from ..report.contents import read_contents
from ..report.pictures import picture_of
from ..report.sections import views_of
from ..training.fitted_pictures import FAR
from ..training.fitting import different_kinds
from ..training.run_directory import read_recipe
from ..training.seen import as_seen
from .answers import Answer, Missing, Request, of_json
from .downloads import exported
from .explaining import SEARCHES, Asked, Explanation, degrees
from .explore import drawn_sample, thumbnail
from .state import State

KEPT, SEEN = 12, 192
"""Fits that stay, and pixels of a picture."""
SCALES = 1e-9, 1e9
"""What readings may be divided by."""
IDENTITY = "unproject.projections.base:Identity"


def show_kinds(state: State, request: Request) -> Answer:
    """Answer with the kinds of pictures that a run can explain, by its recipe.json: nothing is computed."""
    contents = read_contents(state.folder.run(request.text("run")))
    kinds = [_kind(panel) for panel in _objects(contents.recipe["resolved"].get("panels"))]
    different = [kinds[row][1] for row in different_kinds([(projection, set(names)) for projection, names in kinds])]
    several = [name for names in different for name in names] if len(different) > 1 else []
    own = any(names for _, names in kinds)
    told = {"kind": contents.kind, "observations": several, "own": own}
    return of_json({**told, "searches": list(SEARCHES), "suffixes": [*SUFFIXES, ".npz"]})


def _kind(panel: dict[str, Any]) -> tuple[Any, list[str]]:
    """Return the described projection of a panel, and the names of its observations but for the samples themselves."""
    found = [o for o in _objects(panel.get("observations")) if isinstance(o.get("projection"), dict)]
    found = [o for o in found if o["projection"].get("type") != IDENTITY]
    return found[0]["projection"] if found else None, [str(o.get("name")) for o in found]


def _objects(given: Any) -> list[dict[str, Any]]:
    """Return the objects of a list of recipe.json, which may be damaged."""
    return [one for one in given if isinstance(one, dict)] if isinstance(given, list) else []


def begin_fit(state: State, request: Request) -> Answer:
    """Take a picture, and answer with the name of its fit; at most a few wait."""
    asked = _asked(state, request)
    explanation = Explanation(asked)
    explanation.waits = state.jobs.submit(lambda: explanation.explain(state))
    name = secrets.token_hex(8)
    state.kept(("fit", name), lambda: explanation, KEPT)
    return of_json({"fit": name})


def _asked(state: State, request: Request) -> Asked:
    own, search = request.whole("own", -1, -1, 10**6), request.text("search", "quick")
    name = request.text("name") if own < 0 else ""
    if own < 0 and Path(name).suffix.lower() not in (*SUFFIXES, ".npz"):
        raise UserError(f"{name[:80]}: drop a picture ({', '.join(s[1:] for s in SUFFIXES)}), or an .npz")
    if search not in SEARCHES:
        raise UserError(f"search={search[:40]}: choose from {', '.join(SEARCHES)}")
    state.folder.run(request.text("run"))
    known = request.text("observation", "") or None, request.text("view", "")[:80], search
    novelty = request.text("novelty", "1") == "1"
    scale = request.number("scale", 1, *SCALES) if request.text("scale", "") else None
    return Asked(request.text("run"), name, request.body, *known, novelty, scale, None if own < 0 else own)


def _found(state: State, request: Request) -> Explanation:
    name = request.text("fit")[:40]

    def missing() -> Explanation:
        raise Missing("this fit is no longer there; drop the picture again")

    return state.kept(("fit", name), missing, KEPT)


def stop_fit(state: State, request: Request) -> Answer:
    """End a fit that is on its way."""
    _found(state, request).stop()
    return of_json({})


def show_fit(state: State, request: Request) -> Answer:
    """Answer with how far a fit is, and with what was found once it has been."""
    one = _found(state, request)
    name = one.asked.name or "one of its own pictures"
    told = {"run": one.asked.run, "name": name, "stage": one.stage, "ended": one.ended, "done": one.done}
    told |= {"moves": one.moves, "drawable": one.x is not None, "error": one.error, "seconds": round(one.seconds, 1)}
    told |= {"remarks": one.remarks}
    pictures = {"picture": _seen(one, one.pictures), "projection": _seen(one, one.projected)}
    return of_json({**told, **pictures, **(_shown(one, one.fit) if one.fit is not None else {})})


def _shown(one: Explanation, fit: Fit) -> dict[str, Any]:
    """Return the result of a fit, made again only when it has changed: a page looks several times a second."""
    moves = one.moves
    if one.shown is None or one.shown[0] != moves:
        one.shown = moves, _result(one, fit)
    return one.shown[1]


def _seen(one: Explanation, y: Tensor | None) -> str | None:
    if y is None or one.reader is None:
        return None
    shown = as_seen(one.reader.viewing.projection, y)
    return picture_of(export.picture_sheet(shown, columns=min(len(shown), 4), cell=SEEN), "a picture", 2 * SEEN).uri


def _result(one: Explanation, fit: Fit) -> dict[str, Any]:
    run = one.run
    assert run is not None
    described = read_recipe(run.path)["resolved"].get("panels")
    labels, unit = views_of(described, 0, fit.posterior.shape[1])
    formats = sorted(run.domain.exporters)
    return {
        "explained": not one.why,
        "why": "; ".join(one.why),
        "p": one.p,
        "levels": {"distance": FAR, "p": DOUBTFUL},
        "distances": fit.distance.mean(1).tolist(),
        "weights": fit.weight.tolist(),
        "views": degrees(fit),
        "projections": [_seen(one, y) for y in fit.projections],
        "posterior": fit.posterior.mean(0).tolist(),
        "labels": labels,
        "unit": unit,
        "explanations": [thumbnail(run.domain, run.domain.largest_part(x[None])).uri for x in fit.x],
        "formats": formats,
        "format": run.domain.written,
    }


def _sample(one: Explanation, request: Request) -> Tensor:
    """Return the explanation (1, ...) that is asked for, or the best so far."""
    if one.fit is None:
        if one.x is None:
            raise Missing("nothing has been found yet")
        return one.x
    which = request.whole("which", 0, 0, len(one.fit.x) - 1)
    return one.fit.x[which : which + 1]


def draw_fit(state: State, request: Request) -> Answer:
    """Answer with what the browser draws of an explanation."""
    one = _found(state, request)
    assert one.run is not None or one.x is None
    x = _sample(one, request)
    domain = one.run.domain  # pyright: ignore[reportOptionalMemberAccess]
    return of_json(state.compute(lambda: drawn_sample(domain, domain.largest_part(x))))


def download_fit(state: State, request: Request) -> Answer:
    """Answer with an explanation as a file."""
    one = _found(state, request)
    x, run = _sample(one, request), one.run
    assert run is not None
    which = 0 if one.fit is None else request.whole("which", 0, 0, len(one.fit.x) - 1)
    name = Path(one.asked.name).stem + (f"-{which + 1}" if which else "")
    return state.compute(lambda: exported(run.domain, run.domain.largest_part(x), request.text("to"), name))
