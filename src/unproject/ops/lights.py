"""Distant light: from everywhere, from lamps, or of an environment."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from .environment import Environments
from .plane import towards

THIRD = 2 * math.pi / 3


class Ambient(NamedTuple):
    """Radiance 1 from all directions."""


class Directional(NamedTuple):
    """Light from directions (B, 3), unit vectors towards the light; irradiance π on a plane that faces it.

    Or from three, (B, 3, 3), of which the first is red, the second green and the third blue.
    """

    direction: Tensor

    def of_colour(self, k: int) -> Directional:
        """Return the lamp of red (k = 0), green or blue light; a single one is all three."""
        return Directional(self.direction[:, k]) if self.direction.dim() == 3 else self


class Environment(NamedTuple):
    """One of several environments for each batch element: `which` (B,) int64, rotated by `turn` (B,) about z."""

    environments: Environments
    which: Tensor
    turn: Tensor


def coloured_lamps(theta: Tensor, phi: Tensor) -> Directional:
    """Return a red, a green and a blue lamp at polar angles θ (B,), a third of a turn apart; the red one at φ (B,)."""
    return Directional(torch.stack([towards(theta, phi + k * THIRD) for k in range(3)], 1))


Light = Ambient | Directional | Environment
