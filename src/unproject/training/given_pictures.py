"""Pictures given to a run, to be fitted or compared with its samples: read as those it learned from were."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError
from ..assignment import AssignmentState, Panel
from ..data import Collection, are_pictures, mapped, read, read_photographs, read_silhouettes
from ..data.measured_lines import standardised_lines
from ..data.readers.lights import SUFFIXES as MATERIALS
from ..data.readers.pictures import SUFFIXES as PICTURES
from ..data.readers.pictures import required_pictures
from ..inversion import Novelty, Viewing
from ..ops.maps import COLOURED
from ..projections import (
    Cropped,
    FramedSilhouette,
    LineIntegral,
    Projection,
    Rendering,
    Selection,
    Silhouette,
    Standardised,
)
from ..projections.base import Identity
from .fitted_pictures import Frame, given_view, known_views
from .fitting import by_name, novelty_of, state_of, viewing_of

if TYPE_CHECKING:
    from .run import Run

IN_COLOUR = 3
"""Channels of pictures in colour."""
BRIGHT, FAINT = 2.0, 0.01
"""The largest reading, divided as those of training were, from which on it is no picture's, as one of ones reaches √2
along its diagonal; and the largest reading of nearly empty pictures."""
ANOTHER_UNIT = (
    "the largest reading is {1:.3g} after division by {0:g}, but a row of ones in a picture gives 1: "
    "give readings in the unit of training, or what to divide them by as --scale"
)


@dataclass(frozen=True, eq=False)
class PictureReader:
    """Reads pictures that a run is to explain, with what is known of their views.

    Attributes:
        run: what explains them.
        viewing: how they come about.
        state: the panel of such pictures; None if it is none of the run's.
        frame: how known views lie in the frame of the run's samples.
    """

    run: Run
    viewing: Viewing
    state: AssignmentState | None = None
    frame: Frame = Frame()

    @classmethod
    def of(cls, run: Run, observation: str | None, paths: Sequence[Path] = ()) -> PictureReader:
        """Return what reads pictures of one kind.

        Args:
            run: what is to explain them.
            observation: which of the run's they are; None for the only one, or any of the only panel.
            paths: where they are, which tells whether they will be cropped (default: they are as the run's own).

        Raises:
            UserError: if the run has no such observation, or several and none is named, or learned from no pictures.
        """
        states = run.assignments()
        state = state_of(states, observation)
        viewing, frame = viewing_of(state, observation), Frame.of(run.domain, states, state)
        return cls(run, framed_viewing(viewing, paths) if paths else viewing, state, frame)

    def read(self, paths: Sequence[Path], view: str | None = None, scale: float | None = None) -> Collection:
        """Return the pictures as the run's projections are, with their known views.

        Args:
            paths: pictures, or one folder or file of arrays.
            view: of all of them, numbers with commas between, angles in degrees; None if it is not known.
            scale: what line integrals are divided by (default: what those of training were).

        Raises:
            UserError: if they cannot be read, or a view or scale means nothing here.
        """
        self._given(view)  # before pictures are read in vain
        return self.with_views(observed(self.run, paths, self.viewing, scale).warn_skipped(), view)

    def _given(self, view: str | None) -> dict[str, float]:
        return {} if view is None else given_view(view, self.viewing.projection.latents)

    def with_views(self, found: Collection, view: str | None) -> Collection:
        """Return pictures with the view that is given, or else stands beside them, in the frame of the samples."""
        known = known_views(found, self.viewing, self._given(view), self.frame)
        return Collection(found.floats(), names=found.names, latents=known)

    def novelty(self) -> Novelty | None:
        """Return what compares pictures with those of training; None if there are none to compare with."""
        return None if self.state is None else novelty_of(self.state, self.viewing)


def framed_viewing(viewing: Viewing, paths: Sequence[Path]) -> Viewing:
    """Return the viewing of pictures that are cropped as they are read, where the run's were not."""
    cropped = paths[0].is_dir() or are_pictures(paths)
    if cropped and isinstance(viewing.projection, Silhouette):
        return replace(viewing, projection=FramedSilhouette(viewing.projection))
    return viewing


def observed(opened: Run, paths: Sequence[Path], viewing: Viewing, scale: float | None = None) -> Collection:
    """Return the pictures, as the viewing's projection makes them.

    Args:
        scale: what line integrals are divided by (default: the unit of the viewing's projection).
    """
    sample, projection = opened.generator.sample(1, batch=1), viewing.projection
    inner = _plain(projection)
    of_materials = isinstance(inner, Selection | Rendering)
    listed = are_pictures(paths, MATERIALS if of_materials else PICTURES)
    if len(paths) > 1 and not listed:
        raise UserError(f"{paths[0]}, {paths[1]}: give pictures, or one folder, or one .npz")
    if scale is not None and not isinstance(inner, LineIntegral):
        raise UserError(f"--scale {scale:g}: only readings of line integrals are divided by it; leave it out")
    if of_materials:
        return _as_compared(_pictures_of_materials(paths, inner, sample.shape[1:]), projection)
    if isinstance(inner, LineIntegral):
        if listed or paths[0].is_dir():
            raise UserError(f"{paths[0]}: holds no lines, and this run learned from lines; give an .npz of sinograms")
        return _observed_lines(paths[0], inner, len(viewing.priors), inner.unit if scale is None else scale)
    shape = _shape_of_pictures(viewing, sample)
    if projection.silhouettes:
        return _observed_silhouettes(paths, listed, projection, shape[-1])
    if listed:
        raise UserError(f"{paths[0]}: these pictures are no silhouettes; name the folder they lie in, or an .npz")
    latents = (*projection.latents, *projection.optional_latents)
    return _as_compared(read_images(paths[0], shape, latents), projection)


def _as_compared(found: Collection, projection: Projection) -> Collection:
    """Return measured pictures as a projection has them, of any values, with their names and latents."""
    return Collection(
        projection.from_measured(found.floats()), names=found.names, latents=found.latents, skipped=found.skipped
    )


def _plain(projection: Projection) -> Projection:
    """Return what a projection standardises, or itself."""
    return projection.projection if isinstance(projection, Standardised) else projection


def _pictures_of_materials(
    paths: Sequence[Path], projection: Selection | Rendering, sample: Sequence[int]
) -> Collection:
    """Return single maps or photographs of materials as they were measured, of the size of a sample (C, N, N)."""
    files = required_pictures(paths[0], MATERIALS) if paths[0].is_dir() else list(paths)
    name = projection.map if isinstance(projection, Selection) else "photograph"
    return read_photographs(files, sample[-1], name, coloured=sample[0] == COLOURED)


def _observed_lines(path: Path, projection: LineIntegral, bins: int, unit: float) -> Collection:
    """Return line integrals as training took them, divided by `unit`."""
    found = standardised_lines(Collection.lines(path), max(bins, 1), unit, projection.center)
    largest = found.floats().max().item()
    if not FAINT < largest < BRIGHT:
        warnings.warn(f"{path}: {ANOTHER_UNIT.format(unit, largest)}", stacklevel=3)
    return found


def _observed_silhouettes(paths: Sequence[Path], listed: bool, projection: Projection, size: int) -> Collection:
    """Return masks or cut-outs; those that are framed anew are read twice as large."""
    framed = isinstance(projection, Cropped | FramedSilhouette)
    size = 2 * size if framed else size
    if listed:
        found = read_silhouettes(paths, size)
    else:
        found = read(paths[0], None if framed and not paths[0].is_dir() else size)
    if found.shape[0] != 1 or len(found.shape) != 3:
        what = "volumes" if len(found.shape) == 3 else "no pictures"
        raise UserError(f"{paths[0]}: holds {what}, and this run learned from silhouettes; give masks or cut-outs")
    return mapped(found, lambda y: projection.prepare(projection.from_measured(y)))


def _shape_of_pictures(viewing: Viewing, sample: Tensor) -> torch.Size:
    """Return the shape of the pictures of one sample (1, ...)."""
    latents = viewing.draw(torch.zeros(1, dtype=torch.long), {}, generator_at(0))
    with torch.no_grad():
        return viewing.project(sample, latents).shape[1:]


def read_images(path: Path, shape: Sequence[int], latents: Sequence[str] = ()) -> Collection:
    """Return pictures as they are, neither cut nor cropped, grey or in colour as training has them, of its size.

    Args:
        latents: those of an operator of the user's own, that may stand beside them.
    """
    size = shape[-1] if shape[-1] == shape[-2] else None
    return Collection.images(path, size, colour=shape[0] == IN_COLOUR, latents=latents, unbounded=True)


def references(run: Run, path: Path, observation: str | None = None) -> Collection | dict[str, Tensor]:
    """Return held-out samples, or pictures of such, as `Run.evaluate` takes them.

    Args:
        observation: what they are pictures of (default: their shape tells).

    Raises:
        UserError: if there is no such observation, or nothing that can be used.
    """
    sample, states = run.sample(1).shape[1:], by_name(run.assignments())
    if observation is not None:
        if observation not in states:
            raise UserError(f"--observation {observation}: the run has {', '.join(states)}")
        panel = states[observation].panel
        inner = _plain(panel.projection)
        if isinstance(inner, Selection | Rendering) and (path.is_dir() or are_pictures([path], MATERIALS)):
            return {observation: _pictures_of_materials([path], inner, sample).floats()}
        if len(panel.shape) == 3 and not panel.projection.silhouettes:
            return {observation: read_images(path, panel.shape).floats()}
        return {observation: run.domain.read(path, panel.shape[-1]).floats()}
    panels = [state.panel for state in states.values() if len(state.panel.shape) == 3]
    pictured = [panel for panel in panels if not isinstance(panel.projection, Identity)]
    if not pictured:
        return run.domain.read(path, sample[-1])
    panel = pictured[0]
    if not run.domain.reads_silhouettes:
        return _as_stored(path, panel, sample) or run.domain.read(path, sample[-1])
    size, silhouettes = sample[-1], panel.projection.silhouettes
    found = run.domain.read(path, size) if silhouettes else read(path, size, pictures="images")
    if found.shape == (size, size, size) or found.shape == panel.shape:
        return found
    return run.domain.read(path, panel.shape[-1]) if silhouettes else read_images(path, panel.shape)


def _as_stored(path: Path, panel: Panel, sample: Sequence[int]) -> Collection | None:
    """Return what an array file holds if that has the shape of a panel's pictures and not that of a sample."""
    if not path.is_file():
        return None
    with suppress(UserError):  # maps, lines
        found = Collection.images(path, colour=panel.shape[0] == IN_COLOUR, unbounded=True)
        return found if found.shape == panel.shape != tuple(sample) else None
    return None


def unit_of(projection: Projection) -> float:
    """Return what measured readings are divided by before they are compared with projections."""
    return projection.unit if isinstance(projection, LineIntegral) else 1.0
