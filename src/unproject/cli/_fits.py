"""What `unproject fit` writes: an object at a time, so that a run that was stopped goes on where it was."""

from __future__ import annotations

import json
import os
import sys
import time
from dataclasses import asdict, dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from PIL import Image

from .._files import atomic_path, read_json, understood, write_text
from .._types import UserError, printable
from ..data.readers.arrays import load_arrays
from ..data.readers.lights import SUFFIXES
from ..export import MATERIAL_FORMATS, picture_sheet, save_image
from ..inversion.novelty import combined
from ..training.description import describe
from ..training.fitted_pictures import doubts, object_of, view_of
from ..training.given_pictures import unit_of
from ..training.seen import as_seen

if TYPE_CHECKING:
    from torch import Tensor

    from ..data import Collection
    from ..inversion import Fit, Fitter, Novelty
    from ..training import Run

CELL, SHOWN = 96, 24
"""Pixels of a picture on the sheet, and objects on it at most."""
WRITTEN = ("settings.json", "fit.npz", "fit.json", "sheet.png")
"""Files beside the folders of objects, which may not have their names."""


@dataclass(frozen=True, eq=False)
class Job:
    """Pictures to be explained, and how and where.

    Attributes:
        found: the pictures as they are compared, with what is known of their views.
        novelty: compares pictures with those of training; None: they are not compared.
        to: the format of what is found.
    """

    found: Collection
    fitter: Fitter
    novelty: Novelty | None
    opened: Run
    to: str
    out: Path

    def groups(self, together: bool) -> dict[str, list[int]]:
        """Return the rows of each object by its name: lines of one sinogram, `00007#2`, belong together."""
        if together:
            return {"together": list(range(len(self.found)))}
        paths = [Path(os.path.abspath(object_of(name))) for name in self.found.names]
        common = Path(os.path.commonpath([path.parent for path in paths]))
        grouped: dict[str, list[int]] = {}
        made_of: dict[str, Path] = {}
        for row, path in enumerate(paths):
            whole = path.relative_to(common)
            picture = whole.suffix.lower() in SUFFIXES  # of arrays names may have dots
            name = "_".join((whole.with_suffix("") if picture else whole).parts)
            if name.lower() in WRITTEN:  # of some systems capitals are the same file
                raise UserError(f"{path}: its folder would be {name}, which is a file of all fits; rename it")
            if made_of.setdefault(name, path) != path:
                raise UserError(f"{path}: would be called {name}, as {made_of[name]} is; rename one of them")
            grouped.setdefault(name, []).append(row)
        return grouped

    def settings(self) -> str:
        """Return what fits must have in common to lie in one folder."""
        described = [str(self.opened.path), self.opened.step, self.fitter.seed, asdict(self.fitter.search)]
        described += [describe(self.found), describe(self.found.latents), describe(self.fitter.viewing)]
        described += [self.to, self.novelty is not None]
        return sha256(json.dumps(described).encode()).hexdigest()[:16]


def write_fits(job: Job, together: bool) -> None:
    """Find and write each fit, then the files of all of them."""
    groups = job.groups(together)
    job.fitter.check(job.found.subset([0]).floats())  # before anything is written
    settings = job.out / "settings.json"
    _claim(settings, {"settings": job.settings(), "fits": list(groups)})
    try:
        entries = [_entry(job, name, rows, k, len(groups)) for k, (name, rows) in enumerate(groups.items())]
    except UserError:
        if not any((job.out / name / "fit.json").exists() for name in groups):
            settings.unlink()  # nothing was found with these settings, so that others may be tried in this folder
        raise
    found = [_best(job.out / name / "fit.npz") for name in groups]
    job.opened.domain.write_arrays(torch.stack(found), job.out / "fit.npz")
    _write_text(job.out / "fit.json", json.dumps({"run": str(job.opened.path), "fits": entries}, indent=1))
    rows = [Image.open(job.out / name / "fit.png").convert("RGB") for name in list(groups)[:SHOWN]]
    sheet = Image.new("RGB", (max(row.width for row in rows), sum(row.height for row in rows)), "white")
    for k, row in enumerate(rows):
        sheet.paste(row, (0, sum(other.height for other in rows[:k])))
    save_image(sheet, job.out / "sheet.png")
    bad = [entry for entry in entries if not entry["explained"]]
    for entry in bad:  # once all went well: of a mistake there is one line and no more
        print(printable(f"warning: {entry['name']} is not explained: {entry['why']}"), file=sys.stderr)
    print(f"{job.out}: {len(entries)} fits, {len(entries) - len(bad)} of them explain their pictures")


def _entry(job: Job, name: str, rows: list[int], k: int, count: int) -> dict[str, Any]:
    """Return the entry of an object, which is found and written unless it is there; fit.json comes last."""
    file = job.out / name / "fit.json"
    if not file.is_file():
        some, begin = job.found.subset(rows), time.perf_counter()
        fit = job.fitter.fit(some.floats(), some.latents, converted=True)
        entry = {"name": name, **described(job, some, fit), "seconds": round(time.perf_counter() - begin, 2)}
        _write_fit(job, file.parent, some.floats(), fit)
        _write_text(file, json.dumps(entry, indent=1))
    entry = read_json(file, ANEW)
    with understood(file, ANEW):
        distance, seconds = f"distance {entry['distance']:.2f}", f"{entry['seconds']:.1f} s"
        if entry["name"] != name or not isinstance(entry["explained"], bool) or not isinstance(entry["why"], str):
            raise TypeError("it is of another object, or does not say whether that is explained")
    print(printable(f"{name}: {distance}, {len(rows)} pictures, {seconds} ({k + 1}/{count})"), flush=True)
    return entry


ANEW = "remove its folder, and the same command makes it anew"


def described(job: Job, found: Collection, fit: Fit) -> dict[str, Any]:
    """Return what fit.json holds of an object."""
    p = None if job.novelty is None else job.novelty.p_values(found.floats())
    why = doubts(job.opened, fit, p)
    views = [
        {
            "picture": name,
            **view_of(fit, 0, m, digits=2),
            "posterior": [round(share, 4) for share in fit.posterior[m].tolist()],
            "distance": round(fit.distance[0, m].item(), 4),
        }
        for m, name in enumerate(found.names)
    ]
    weights = [round(weight, 4) for weight in fit.weight.tolist()]
    likely = None if p is None else round(combined(p), 4)
    verdict = {"explained": not why, "why": "; ".join(why), "p": likely}
    unit = unit_of(job.fitter.viewing.projection)
    return {
        **verdict,
        **({} if unit == 1 else {"unit": unit / found.shape[-1]}),
        "distance": round(fit.error, 4),
        "consistent": fit.consistent,
        "weights": weights,
        "views": views,
    }


def _write_fit(job: Job, folder: Path, pictures: Tensor, fit: Fit) -> None:
    domain = job.opened.domain
    arrays = {"x": fit.x, "mean": fit.mean, "deviation": fit.deviation, "weight": fit.weight, "latent": fit.latent}
    with atomic_path(folder / "fit.npz") as temporary, temporary.open("wb") as stream:
        np.savez_compressed(stream, **{name: value.numpy() for name, value in arrays.items()})  # pyright: ignore
    file = folder / ("textures" if job.to in MATERIAL_FORMATS else f"{folder.name}.{job.to}")
    if not domain.empty(fit.x[:1]):
        domain.write(fit.x[:1], job.to, file)
    seen = [as_seen(job.fitter.viewing.projection, y) for y in (pictures, fit.projected)]
    pairs = torch.stack(seen, 1).flatten(0, 1)
    shown = picture_sheet(pairs, columns=2, cell=CELL)
    preview = domain.preview(fit.x[:1])
    row = Image.new("RGB", (shown.width + preview.width, max(shown.height, preview.height)), "white")
    row.paste(shown, (0, 0))
    row.paste(preview, (shown.width, 0))
    save_image(row, folder / "fit.png")


def _best(file: Path) -> Tensor:
    with understood(file, ANEW):
        return torch.from_numpy(load_arrays(file)["x"][0])


def _claim(file: Path, settings: dict[str, Any]) -> None:
    """Refuse a folder that holds other fits, or the same by other settings."""
    if file.is_file() and read_json(file, "give another --out, or remove that folder") != settings:
        raise UserError(f"{file.parent}: holds fits of other pictures or with other flags; give another --out")
    if not file.is_file():
        if file.parent.is_dir() and any(file.parent.iterdir()):
            raise UserError(f"{file.parent}: is not empty and holds no fits; give another --out")
        _write_text(file, json.dumps(settings))


def _write_text(file: Path, text: str) -> None:
    write_text(file, text + "\n")
