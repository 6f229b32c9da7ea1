"""Distant light: from everywhere, from lamps, or of an environment."""

from __future__ import annotations

from typing import NamedTuple

from torch import Tensor

from .environment import Environments


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


Light = Ambient | Directional | Environment
