"""Explaining: the sample behind a picture that was dropped, as far as it has been found; as `unproject fit` does it."""

from __future__ import annotations

import re
import tempfile
import threading
import time
import warnings
from concurrent.futures import Future
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor

from .._types import UserError
from ..assignment import Panel
from ..data import Collection
from ..inversion import Fit, Fitter, Search
from ..inversion.novelty import combined
from ..training import Run
from ..training.fitted_pictures import doubts, object_of, view_of
from ..training.fitting import viewing_of
from ..training.given_pictures import PictureReader

if TYPE_CHECKING:
    from .state import State

SEARCHES = {"quick": Search(64, 4, 40, tune=0), "thorough": Search(starts=8, tune=30)}
"""By name; the thorough one is that of `unproject fit`."""


class Stopped(Exception):
    """Nobody wants the answer any more."""


@dataclass(frozen=True)
class Asked:
    """What was dropped, and what is said of it.

    Attributes:
        run: name of the run.
        name: of the file.
        content: of the file.
        observation: which of the run's observations made it; None for the only ones.
        view: degrees, with commas; "" if it is not known.
        search: a name of `SEARCHES`.
        novelty: compare it with pictures of training.
        scale: what readings of line integrals are divided by; None for what those of training were.
        own: the number of a picture of the run's own that is meant in place of a file, if there is one.
    """

    run: str
    name: str
    content: bytes = field(repr=False)
    observation: str | None = None
    view: str = ""
    search: str = "quick"
    novelty: bool = True
    scale: float | None = None
    own: int | None = None

    @property
    def framed(self) -> bool:
        """Whether it is framed as it is read: pictures are, not those of the run or of an .npz."""
        return self.own is None and Path(self.name).suffix.lower() != ".npz"

    def reader(self, run: Run) -> PictureReader:
        """Return what reads it; a picture of the run's own may be of any observation of its panel."""
        reader = PictureReader.of(run, self.observation, [Path(self.name)] if self.framed else ())
        if self.own is None or reader.state is None:
            return reader
        return replace(reader, viewing=viewing_of(reader.state))


class Explanation:
    """A fit on its way; one thread moves it on while others look.

    Attributes:
        stage: what is being done; "done", "stopped" or "failed" at the end.
        done: the part of the descent that is done.
        moves: counts the changes of what can be seen.
        x, projected: the best sample so far (1, ...), and its projections.
        pictures: as they are compared, (M, ...).
        fit: what was found, with `why` it does not explain the pictures, and p.
        error: what went wrong.
        remarks: what is to be known of how the pictures were read.
        shown: what a page was told of the result, after so many moves.
        waits: for its turn to be explained.
    """

    def __init__(self, asked: Asked) -> None:
        self.asked, self.stage, self.done, self.moves, self.error = asked, "waiting", 0.0, 0, ""
        self.run: Run | None = None
        self.reader: PictureReader | None = None
        self.pictures: Tensor | None = None
        self.x: Tensor | None = None
        self.projected: Tensor | None = None
        self.fit: Fit | None = None
        self.why: list[str] = []
        self.remarks: list[str] = []
        self.p: float | None = None
        self.seconds = 0.0
        self.shown: tuple[int, dict[str, Any]] | None = None
        self.waits: Future[None] | None = None
        self._unwanted = threading.Event()

    @property
    def ended(self) -> bool:
        return self.stage in ("done", "stopped", "failed")

    def stop(self) -> None:
        """End it at the next step, or at once if it waits."""
        self._unwanted.set()
        if self.waits is not None and self.waits.cancel():
            self._end("stopped")

    def explain(self, state: State) -> None:
        """Do it, from reading the picture on; what goes wrong is kept for whoever looks."""
        begin = time.perf_counter()
        try:
            self._explain(state)
            ended = "done"
        except Stopped:
            ended = "stopped"
        except Exception as error:  # a part of the user's own may fail in any way
            self.error = " ".join(str(error).split()) or type(error).__name__
            ended = "failed"
        self.seconds = time.perf_counter() - begin
        self._end(ended)

    def _explain(self, state: State) -> None:
        asked = self.asked
        self._now("opening the run")
        self.run = run = state.opened(asked.run)
        key = (asked.run, state.version(run), asked.observation, asked.own is None, asked.framed)
        self.reader = reader = state.kept(("reader", *key), lambda: asked.reader(run), 2)
        search = SEARCHES[asked.search]
        fitter: Fitter = state.kept(
            ("fitter", *key, asked.search), lambda: run.fitter(viewing=reader.viewing, search=search), 2
        )
        self._now("reading the picture")
        found, self.remarks = _read(asked, reader)
        self.asked = replace(asked, name=asked.name or found.names[0])
        self.pictures = pictures = found.floats()
        self._now("comparing it with samples")
        fit = fitter.fit(pictures, found.latents, self._watch, converted=True)
        self.x, self.projected, self.why = fit.x[:1], fit.projected, doubts(run, fit, None)
        self.fit = fit
        if asked.novelty:
            self._now("comparing it with the pictures of training")
            novelty = state.kept(("novelty", *key), reader.novelty, 2)
            p = None if novelty is None else novelty.p_values(pictures)
            self.p, self.why = None if p is None else combined(p), doubts(run, fit, p)

    def _watch(self, done: float, x: Tensor, projected: Tensor) -> None:
        self.done, self.x, self.projected = done, x, projected
        self._now("moving the sample towards the picture")

    def _end(self, stage: str) -> None:
        self.asked = replace(self.asked, content=b"")  # as large as a picture may be
        self.stage, self.moves = stage, self.moves + 1

    def _now(self, stage: str) -> None:
        self.stage, self.moves = stage, self.moves + 1
        if self._unwanted.is_set():
            raise Stopped


def _read(asked: Asked, reader: PictureReader) -> tuple[Collection, list[str]]:
    """Return the pictures of the first object of a file, or of one of the run, and remarks on them.

    What the command says in a terminal is said in the page: without dashes before what is a field there.

    Raises:
        UserError: if it cannot be read.
    """
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        file = Path(folder) / f"picture{Path(asked.name).suffix.lower()}"
        file.write_bytes(asked.content)

        def said(text: object) -> str:
            return re.sub(r"--(view|scale)\b", r"\1", str(text).replace(str(file), asked.name[:80]))

        try:
            found = _known(asked, reader, file)
        except UserError as error:
            raise UserError(said(error)) from None
    objects = len({object_of(name) for name in found.names})
    several = [f"{asked.name[:80]} holds {objects} objects, of which the first is explained"] if objects > 1 else []
    return found.subset(_rows_of(found, found.names[0])), [*several, *(said(one.message) for one in told)]


def _known(asked: Asked, reader: PictureReader, file: Path) -> Collection:
    """Return all pictures of a file, or those of one object of the run, with what is known of their views."""
    if asked.own is None or reader.state is None:
        return reader.read([file], asked.view or None, asked.scale)
    return reader.with_views(_own(asked.own, reader.state.panel), asked.view or None)


def _own(number: int, panel: Panel) -> Collection:
    """Return a picture of a panel, one that is held out if there are such; of lines, all of one image, and angles."""
    sources = panel.collections if panel.held_out is None else (panel.held_out,)
    source = sources[number % len(sources)]
    row = number // len(sources) % len(source)
    if len(source.shape) > 2:
        return Collection(source.batch(torch.tensor([row])), names=[source.names[row]])
    if object_of(source.names[row]) == source.names[row]:  # nothing says which others are of the same image
        return source.subset([row])
    parts = [part.subset(rows) for part in sources if (rows := _rows_of(part, source.names[row]))]
    known = [part.latents for part in parts if part.latents is not None]
    latents = {name: torch.cat([one[name] for one in known]) for name in known[0]} if len(known) == len(parts) else None
    lines, names = torch.cat([part.floats() for part in parts]), [name for part in parts for name in part.names]
    return Collection(lines, names=names, latents=latents)


def _rows_of(found: Collection, name: str) -> list[int]:
    """Return the rows of the pictures of the same object as one of this name."""
    wanted = object_of(name)
    return [row for row, other in enumerate(found.names) if object_of(other) == wanted]


def degrees(fit: Fit) -> list[list[dict[str, float]]]:
    """Return the view of each explanation, of each picture (`view_of`)."""
    explanations, pictures = fit.distance.shape
    return [[view_of(fit, k, m) for m in range(pictures)] for k in range(explanations)]
