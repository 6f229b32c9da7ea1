"""Pictures that are to be fitted: read as the run's own were, and what is said of how well they are explained."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping, Sequence
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
from ..data.readers.lines import MAX_ANGLE
from ..data.readers.pictures import SUFFIXES as PICTURES
from ..data.readers.pictures import required_pictures
from ..domains import Domain
from ..inversion import DOUBTFUL, Fit, Viewing
from ..inversion.novelty import combined
from ..metrics import Gauge
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
from .evaluation import accuracy_of, estimated_and_true, turns_of
from .fitting import by_name

if TYPE_CHECKING:
    from .run import Run

FAR = 0.6
"""The distance of a fit beyond which pictures are not explained; of chairs that were held out 5 % are beyond 0.52."""


TOLD = 2
"""How many times as often as by chance known views have to be found, for them to tell how samples are turned."""
ANGLES = ("azimuth", "elevation", "roll", "angle", "view", "light", "light_azimuth", "view_azimuth")
NO_VIEWS = ("probe", "jitter")
"""Latents that are angles, in degrees where people read or write them; and those that say nothing of the camera or the
light."""


def object_of(name: str) -> str:
    """Return the object that a picture is of, by its name: lines of one sinogram, `00007#2`, have one.

    Examples:
        >>> object_of("00007#2"), object_of("chair #2.png")
        ('00007', 'chair #2.png')
    """
    return re.sub(r"#\d+$", "", name)


def view_of(fit: Fit, explanation: int, picture: int, digits: int = 1) -> dict[str, float]:
    """Return from where an explanation says that a picture was taken: its latents, `ANGLES` in degrees."""
    found = {name: value[explanation, picture].item() for name, value in fit.theta.items() if name not in NO_VIEWS}
    turns = {name: v % math.tau if name == "azimuth" else v for name, v in found.items()}
    return {name: round(math.degrees(v) if name in ANGLES else v, digits) for name, v in turns.items()}


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
    inner = projection.projection if isinstance(projection, Standardised) else projection
    of_materials = isinstance(inner, Selection | Rendering)
    listed = are_pictures(paths, MATERIALS if of_materials else PICTURES)
    if len(paths) > 1 and not listed:
        raise UserError(f"{paths[0]}, {paths[1]}: give pictures, or one folder, or one .npz")
    if of_materials:
        files = required_pictures(paths[0], MATERIALS) if paths[0].is_dir() else list(paths)
        name = inner.map if isinstance(inner, Selection) else "photograph"
        found = read_photographs(files, sample.shape[-1], name, coloured=sample.shape[1] == COLOURED)
        return Collection(projection.from_measured(found.floats()), names=found.names)
    if isinstance(inner, LineIntegral):
        if listed or paths[0].is_dir():
            raise UserError(f"{paths[0]}: holds no lines, and this run learned from lines; give an .npz of sinograms")
        return _observed_lines(paths[0], inner, len(viewing.priors), inner.unit if scale is None else scale)
    shape = _shape_of_pictures(viewing, sample)
    if not projection.silhouettes:
        if listed:
            raise UserError(f"{paths[0]}: these pictures are no silhouettes; name the folder they lie in, or an .npz")
        latents = (*projection.latents, *projection.optional_latents)
        return mapped(read_images(paths[0], shape, latents), projection.from_measured)
    framed = isinstance(projection, Cropped | FramedSilhouette)  # these are framed anew, from more pixels
    size = 2 * shape[-1] if framed else shape[-1]
    if listed:
        found = read_silhouettes(paths, size)
    else:
        found = read(paths[0], None if framed and not paths[0].is_dir() else size)
    if len(found.shape) != 3:
        raise UserError(f"{paths[0]}: holds no pictures, and this run learned from silhouettes; give masks or cut-outs")
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


IN_COLOUR = 3


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


def _observed_lines(path: Path, projection: LineIntegral, bins: int, unit: float) -> Collection:
    """Return line integrals as training took them, divided by `unit`."""
    found = standardised_lines(Collection.lines(path), max(bins, 1), unit, projection.center)
    largest = found.floats().max().item()
    if not FAINT < largest < BRIGHT:
        warnings.warn(f"{path}: {ANOTHER_UNIT.format(unit, largest)}", stacklevel=3)
    return found


BRIGHT, FAINT = 2.0, 0.01
"""The largest reading, divided as those of training were, from which on it is no picture's, as one of ones reaches √2
along its diagonal; and the largest reading of nearly empty pictures."""
ANOTHER_UNIT = (
    "the largest reading is {1:.3g} after division by {0:g}, but a row of ones in a picture gives 1: "
    "give readings in the unit of training, or what to divide them by as --scale"
)


def unit_of(projection: Projection) -> float:
    """Return what measured readings are divided by before they are compared with projections."""
    return projection.unit if isinstance(projection, LineIntegral) else 1.0


@dataclass(frozen=True)
class Frame:
    """How known views lie in the frame of a run's samples.

    Attributes:
        turned: the latent that a run which found its views itself knows up to a turn only (default: none is).
        gauge: from the frame of its samples to that of known views, where its training pictures tell it.
    """

    turned: str | None = None
    gauge: Gauge | None = None

    @classmethod
    def of(cls, domain: Domain, states: Sequence[AssignmentState], state: AssignmentState) -> Frame:
        """Return that of a run's samples, by the known views of a panel's pictures if there are any."""
        if turns_of(domain, states) is None:
            return cls()
        found, turned = estimated_and_true(domain, state), domain.turned_by
        if found is None or turned != "azimuth":
            return cls(turned)
        rows, estimated, true = found
        accuracy = accuracy_of(domain, state.panel, estimated[rows], true[rows])
        return cls(turned, accuracy.gauge if accuracy.exact > TOLD * accuracy.chance_exact else None)

    def moved(self, latents: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Return known latents in the frame of the samples, without what cannot be told there."""
        kept = dict(latents)
        if self.turned in kept:
            turned = kept.pop(self.turned)
            if self.gauge is not None:
                kept[self.turned] = self.gauge.azimuth_of(turned)
        return kept


def known_views(
    found: Collection, viewing: Viewing, given: Mapping[str, float], frame: Frame = Frame()
) -> dict[str, Tensor] | None:
    """Return what is known of each picture's view: what is given, or else stands beside the pictures.

    Raises:
        UserError: if what is given cannot be told in the frame of the run's samples.
    """
    taken = {*viewing.projection.latents, *viewing.projection.optional_latents}
    beside = {name: value for name, value in (found.latents or {}).items() if name in taken}
    known = beside | {name: torch.full((len(found),), value) for name, value in given.items()}
    moved = frame.moved(known)
    if lost := known.keys() - moved.keys():
        why = f"this run found its views itself, so that no side of its samples is known to be at {frame.turned} 0"
        if lost & given.keys():
            raise UserError(f"the given view cannot be used: {why}; leave it out, or train with known views")
        warnings.warn(f"the {frame.turned} beside the pictures is not used: {why}", stacklevel=2)
    return moved or None


def doubts(run: Run, fit: Fit, p: Tensor | None) -> list[str]:
    """Return why pictures are not explained; nothing if they are.

    Args:
        p: of each picture, how likely one of the run's kind is so strange; None if that was not looked at.
    """
    why = []
    if p is not None and combined(p) < DOUBTFUL:
        why.append(f"its pictures are of another kind than those of training (p {combined(p):.3f})")
    if not fit.error <= FAR:
        why.append(f"no sample's projection comes near (distance {fit.error:.2f}, {FAR:g} is far)")
    if run.domain.empty(fit.x[:1]):
        why.append("nothing is to be seen of what was found, so that it has no file")
    return why


def given_view(view: str, latents: Sequence[str]) -> dict[str, float]:
    """Return the latents that --view gives, `ANGLES` in radians, in the order in which the projection takes them."""
    if not latents:
        raise UserError(f"--view {view}: these pictures have no view; leave it out")
    try:
        numbers = [float(part) for part in view.split(",")]
    except ValueError:
        numbers = []
    given = dict(zip(latents, numbers, strict=False))
    beyond = any(abs(value) > MAX_ANGLE for name, value in given.items() if name in ANGLES)
    if not 1 <= len(numbers) <= len(latents) or beyond or not all(map(math.isfinite, numbers)):
        mixed = ", ".join(f"{name} in degrees" if name in ANGLES else f"{name} as it is" for name in latents)
        what = f"degrees of {', '.join(latents)}" if {*latents} <= {*ANGLES} else mixed
        raise UserError(f"--view {view}: give {what}, with commas between")
    if latents[0] == "view" and not abs(numbers[0]) < 90:
        raise UserError(f"--view {view}: the camera must be above the material, less than 90 degrees from the normal")
    if abs(given.get("elevation", 0)) > 90:
        raise UserError(f"--view {view}: an elevation of {given['elevation']:g} degrees is beyond a pole")
    return {name: math.radians(value) if name in ANGLES else value for name, value in given.items()}
