"""Explore: samples to pick from, and the sample at any place of the latents as what the browser draws."""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor

from .. import export
from .._types import UserError
from ..domains import Domain
from ..domains.maps import under_a_lamp
from ..report.materials import is_material, material_data
from ..report.pictures import Picture, picture_of
from ..report.shapes import is_drawable, shape_data
from ..training import Run
from .answers import Answer, Request, of_json
from .downloads import exported
from .space import PICKS, Space
from .state import State

PAGE_SAMPLES, CELL = 24, 112
"""Samples on one page of the grid, and pixels of each."""
FACES = 16_000


def space_of(state: State, request: Request) -> Space:
    """Return the space of a run, made once for each checkpoint."""
    run = state.shown(request)
    return state.kept(("space", request.text("run"), state.version(run)), lambda: Space.of(run), 3)


def show_grid(state: State, request: Request) -> Answer:
    """Answer with samples to pick from, a page of them, and how many sliders there are."""
    name, page = request.text("run"), request.whole("page", 0, 0, PICKS // PAGE_SAMPLES - 1)

    def grid() -> dict[str, Any]:
        run = state.shown(request)
        seen = state.kept(("grid", name, state.version(run), page), lambda: _thumbnails(run, page), 16)
        return {
            "kind": run.domain.name,
            "step": run.step,
            "pages": PICKS // PAGE_SAMPLES,
            "sliders": len(space_of(state, request).directions),
            "formats": sorted(run.domain.exporters),
            "format": run.domain.written,
            "samples": [{"pick": page * PAGE_SAMPLES + k, "picture": uri} for k, uri in enumerate(seen)],
        }

    return of_json(state.compute(grid))


def _thumbnails(run: Run, page: int) -> list[str]:
    x = run.sample((page + 1) * PAGE_SAMPLES, seed=0, largest_part=True)[page * PAGE_SAMPLES :]
    return [thumbnail(run.domain, one[None]).uri for one in x]


def thumbnail(domain: Domain, x: Tensor) -> Picture:
    """Return a small picture of one sample (1, ...)."""
    if is_drawable(x) and domain.name == "volume":
        return picture_of(export.gallery(x, size=CELL, columns=1), "a shape")
    if is_material(domain, x):  # diffuse alone, metals would be black
        lit = under_a_lamp(x, domain.fresnel)  # pyright: ignore[reportAttributeAccessIssue]
        return picture_of(export.picture_sheet(lit, columns=1), "a material", CELL)
    if domain.name == "image":
        return picture_of(export.picture_sheet(x, columns=1, cell=CELL), "an image", CELL)
    return picture_of(domain.preview(x), "a sample", CELL)


def show_sample(state: State, request: Request) -> Answer:
    """Answer with the sample at a place: a mesh, maps or a picture."""
    return of_json(state.compute(lambda: drawn(space_of(state, request), request)))


def drawn(space: Space, request: Request) -> dict[str, Any]:
    """Return what the browser draws of the sample at the place of a request, and the step of the weights."""
    return {**drawn_sample(space.run.domain, at_place(space, request)), "step": space.run.step}


def drawn_sample(domain: Domain, x: Tensor) -> dict[str, Any]:
    """Return what the browser draws of a sample (1, ...)."""
    if domain.name == "volume" and is_drawable(x):
        found = shape_data(x, 1, FACES)
        if not found["items"]:
            raise UserError("nothing is to be seen of this one; choose another, or move the sliders back")
        return found
    if is_material(domain, x):
        return material_data(x, domain, 1)  # pyright: ignore[reportArgumentType]
    return {"kind": "picture", "picture": large(domain, x).uri}


def download(state: State, request: Request) -> Answer:
    """Answer with the sample at a place as a file."""

    def file() -> Answer:
        space = space_of(state, request)
        name = file_name(space.run.path.resolve().name, request)
        return exported(space.run.domain, at_place(space, request), request.text("to"), name)

    return state.compute(file)


def file_name(run: str, request: Request) -> str:
    """Return the name of a sample's file: run and number, as `export` counts them, and whether it was changed."""
    name = f"{run}-{request.whole('pick', 0, 0, PICKS - 1):02d}"
    if request.text("other", "") and request.number("mix", 0, 0, 1):
        name += f"-to-{request.whole('other', 0, 0, PICKS - 1):02d}"
    changed = request.text("slides", "") or request.number("truncation", 1, 0, 1) < 1
    return f"{name}-changed" if changed else name


def at_place(space: Space, request: Request) -> Tensor:
    """Return the sample (1, ...) at the place of a request, in one part."""
    return space.run.domain.largest_part(space.samples(space.place(request)))


def large(domain: Domain, x: Tensor) -> Picture:
    """Return one sample (1, ...) as a picture that fills a panel."""
    if domain.name == "image" and x.dim() == 4:
        with torch.no_grad():
            return picture_of(export.picture_sheet(x, columns=1, cell=512), "an image")
    return picture_of(domain.preview(x), "a sample")
