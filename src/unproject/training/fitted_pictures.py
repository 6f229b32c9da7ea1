"""What a fit is told of its pictures, and what is said of it: objects, known views, and why it is in doubt."""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from .._types import UserError
from ..assignment import AssignmentState
from ..data import Collection
from ..data.readers.lines import MAX_ANGLE
from ..domains import Domain
from ..inversion import DOUBTFUL, Fit, Viewing
from ..inversion.novelty import combined
from ..metrics import Gauge
from .evaluation import accuracy_of, estimated_and_true, turns_of

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
