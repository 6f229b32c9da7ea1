"""Routes: which function answers which address."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib.resources import files

from . import collections, explore, fits, materials, runs
from .answers import Answer, Missing, Request, tagged
from .state import State

Route = Callable[[State, Request], Answer]

KINDS = {"html": "text/html; charset=utf-8", "css": "text/css; charset=utf-8", "js": "text/javascript; charset=utf-8"}
OWN = (
    "app.js",
    "studio.css",
    "runs.js",
    "explore.js",
    "choose.js",
    "materials.js",
    "collections.js",
    "export.js",
    "fit.js",
)
REPORT = ("viewer.js", "shapes.js", "materials.js", "page.css")
"""Files of the page: its own, and those that the report has too."""


def _file(package: str, name: str) -> Route:
    def answer(state: State, request: Request) -> Answer:
        content = (files(package) / "assets" / name).read_bytes()
        return tagged(Answer(content, KINDS[name.rpartition(".")[2]]), request)

    return answer


def _favicon(state: State, request: Request) -> Answer:
    raise Missing("the studio has no icon")


PAGE: Mapping[str, Route] = {
    "/": _file("unproject.studio", "studio.html"),
    "/favicon.ico": _favicon,
    **{f"/assets/{name}": _file("unproject.studio", name) for name in OWN},
    **{f"/assets/report/{name}": _file("unproject.report", name) for name in REPORT},
}
"""Path → what answers with a file of the page, in which there is nothing of any run."""

ROUTES: Mapping[tuple[str, str], Route] = {
    **{("GET", path): answer for path, answer in PAGE.items()},
    ("GET", "/api/runs"): runs.list_runs,
    ("GET", "/api/run"): runs.show_run,
    ("GET", "/api/newest"): runs.newest,
    ("GET", "/api/picture"): runs.picture,
    ("GET", "/api/grid"): explore.show_grid,
    ("GET", "/api/sample"): explore.show_sample,
    ("GET", "/api/maps"): materials.show_maps,
    ("GET", "/api/render"): materials.render,
    ("POST", "/api/light"): materials.add_light,
    ("GET", "/api/collection"): collections.show_collection,
    ("GET", "/api/pictures"): collections.show_pictures,
    ("POST", "/api/view"): collections.correct,
    ("GET", "/api/export"): explore.download,
    ("GET", "/api/views.csv"): collections.download_views,
    ("GET", "/api/report.html"): runs.download_report,
    ("GET", "/api/kinds"): fits.show_kinds,
    ("POST", "/api/fit"): fits.begin_fit,
    ("POST", "/api/stop"): fits.stop_fit,
    ("GET", "/api/fit"): fits.show_fit,
    ("GET", "/api/fit/drawn"): fits.draw_fit,
    ("GET", "/api/fit/file"): fits.download_fit,
}
"""(method, path) → what answers."""
