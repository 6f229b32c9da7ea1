"""The report of a run as one HTML file that needs no other, no network and no server."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from .._files import atomic_path
from .._types import UserError
from ..domains import Domain, Maps
from ..training import Run, load
from ..training.run_directory import REPORT
from .contents import Contents, read_contents
from .markup import asset, page, paragraph, picture, section, text
from .materials import is_material, material_data
from .numbers import json_inside_html
from .pictures import Picture, over_time, samples_now, training_pictures
from .sections import (
    commands_section,
    curves_section,
    data_section,
    duration,
    environment_section,
    time_section,
    verdict_section,
    views_section,
)
from .shapes import is_drawable, shape_data

MAX_PAGE_BYTES = 5_000_000
"""Bytes that a page stays under."""
AMOUNTS = ((24, 8, 16_000), (12, 4, 8_000), (4, 1, 4_000))
"""(pictures over time, samples of the viewer, triangles of each), until the page is small enough."""
DRAWN = 64
"""Samples drawn for the page."""


def write_report(
    run: Run | str | PathLike[str],
    out: str | PathLike[str] | None = None,
    *,
    data: bool = True,
    trust: bool = False,
) -> Path:
    """Write the report of a run, under 5 MB, whole or not at all; draws from no global random state.

    A run that is unfinished or damaged has a report too, which says so.

    Args:
        run: the run, or its directory.
        out: the file to write (default: RUN/report.html).
        data: show training pictures, for which the recipe is made again unless the run was trained in this process.
        trust: import code outside this package.

    Raises:
        UserError: if there is no run, or its recipe.json is damaged.
        OSError: if the file cannot be written.

    Examples:
        >>> import functools, unproject as up
        >>> panel = up.Panel([up.Observation("itself", up.Identity())], up.Collection(up.data.chairs(4, 16)))
        >>> recipe = up.Recipe(
        ...     functools.partial(up.networks.LowRankGenerator, size=16, channels=8, rank=4, code_size=4),
        ...     [panel],
        ...     discriminator=functools.partial(up.networks.Discriminator, channels=4, volumetric=True),
        ...     steps=1,
        ...     batch=2,
        ... )
        >>> up.report.write_report(up.train(recipe, "runs/reported", quiet=True)).name
        'report.html'
    """
    path = run.path if isinstance(run, Run) else Path(run)
    final = path / REPORT if out is None else Path(out)
    if final.is_dir():
        raise UserError(f"{final}: is a folder; give the name of a file, such as {final / REPORT}")
    contents = read_contents(path)
    opened = run if isinstance(run, Run) else _opened(contents, trust)
    sheets, why_none = _training_pictures(opened) if data and opened else ([], _no_pictures(data))
    for amounts in AMOUNTS:
        content = _page(contents, opened, sheets, why_none, amounts).encode()
        if len(content) < MAX_PAGE_BYTES:
            break
    with atomic_path(final) as temporary:
        temporary.write_bytes(content)
    return final


def _no_pictures(data: bool) -> str:
    return "the run cannot be opened." if data else "left out with --no-data."


def _opened(contents: Contents, trust: bool) -> Run | None:
    """Open the run, or say in the report why it cannot be."""
    if not contents.step:
        return None
    try:
        return load(contents.path, trust=trust)
    except Exception as error:  # a foreign generator may fail in any way
        contents.remarks.append(f"There are no samples: {error}")
        return None


def _training_pictures(run: Run) -> tuple[list[tuple[str, Picture]], str]:
    """Return sheets of training pictures, or why there are none: the data may have been moved since."""
    try:
        return training_pictures(run.recipe().panels), ""
    except Exception as error:  # a recipe of the user's own may fail in any way
        return [], str(error) or type(error).__name__


@torch.no_grad()
def _page(
    contents: Contents,
    run: Run | None,
    sheets: list[tuple[str, Picture]],
    why_none: str,
    amounts: tuple[int, int, int],
) -> str:
    frames, count, faces = amounts
    samples, data = _samples_section(contents, run, count, faces)
    shown, damaged = over_time(contents.previews, frames)
    body = [
        _header(contents),
        "<main>",
        verdict_section(contents),
        samples,
        time_section(shown, damaged),
        curves_section(contents),
        views_section(contents),
        data_section(contents, sheets, why_none),
        commands_section(contents),
        environment_section(contents),
        "</main><footer><p class='small'>Written by unproject. This file loads nothing.</p></footer>",
    ]
    names = ["viewer.js", "shapes.js" if data.get("kind") == "shapes" else "materials.js"] if data else []
    if data:
        body.append(f'<script type="application/json" id="viewer-data">{json_inside_html(data)}</script>')
    return page(f"{contents.name} – unproject report", body, [asset(name) for name in (*names, "page.js")])


def _header(contents: Contents) -> str:
    facts = f"recipe {contents.recipe['recipe']} · {contents.step:,} steps · {duration(contents.seconds)}"
    return f'<header><h1>{text(contents.name)}</h1><p class="facts">{text(facts)}</p></header>'


def _samples_section(contents: Contents, run: Run | None, count: int, faces: int) -> tuple[str, dict[str, Any]]:
    """Return the section, and what its viewer draws; empty for samples that have none."""
    if run is None:
        return section("Samples", paragraph("There are none yet.")), {}
    try:
        x = run.sample(max(min(run.domain.previewed, DRAWN), 16), seed=0)
        grid, data = picture(samples_now(run.domain, x)), _viewer_data(run.domain, x, count, faces)
    except Exception as error:  # a foreign domain may fail in any way
        contents.remarks.append(f"Samples cannot be shown: {type(error).__name__}: {error}")
        return section("Samples", paragraph("They cannot be shown.")), {}
    says = "Fresh samples of seed 0, as they come: none was picked."
    if not data:
        return section("Samples", f'<div class="now alone">{grid}</div>', paragraph(says, "small")), {}
    return section("Samples", f'<div class="now">{_viewer(data)}{grid}</div>', paragraph(says, "small")), data


def _viewer_data(domain: Domain, x: Tensor, count: int, faces: int) -> dict[str, Any]:
    if isinstance(domain, Maps) and is_material(domain, x):
        return material_data(x, domain, count)
    found = shape_data(x, count, faces) if domain.name == "volume" and is_drawable(x) else {}
    return found if found.get("items") else {}


def _viewer(data: dict[str, Any]) -> str:
    shape = data["kind"] == "shapes"
    how = "Turn it: drag, or arrow keys." if shape else "Move the light: point at the material, or arrow keys."
    kind, label = ("", "a shape that can be turned") if shape else ("tile", "a material that can be lit")
    return (
        f'<figure><canvas id="viewer" class="{kind}" tabindex="0" role="img" aria-label="{label}"></canvas>'
        '<div class="bar" id="chooser"></div>'
        f'<figcaption class="small">{how} <span id="viewer-note">It needs scripts.</span></figcaption></figure>'
    )
