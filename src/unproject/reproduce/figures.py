"""List the figures of the paper, with the arms and claims of each."""

from __future__ import annotations

from .figure import Arm, Claim, Figure
from .figures_of_digits import DIGITS
from .figures_of_materials import MATERIALS
from .figures_of_shapes import SHAPES, VIEWS

FIGURES: dict[str, Figure] = {figure.name: figure for figure in (*SHAPES, VIEWS, *MATERIALS, DIGITS)}

__all__ = ["FIGURES", "Arm", "Claim", "Figure"]
