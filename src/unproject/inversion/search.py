"""Search: the settings of a fit."""

from __future__ import annotations

import math
from dataclasses import dataclass

from .._types import UserError

MAX_RATE = 1e30
"""What float32 holds; nothing is found with far less."""


@dataclass(frozen=True)
class Search:
    """Settings of a fit; `Fitter` has the formula.

    Args:
        candidates: samples that are compared with the pictures first.
        starts: candidates that the descent begins from, and explanations that are returned.
        steps: of the descent.
        rate: Adam's, in standard deviations of latents; it falls to a tenth.
        prior: λ, the weight of usual latents.
        view_searches: how often views that are not known are searched anew during the descent.
        tune: steps that also train the generator's own weights for these pictures alone, from the best latent on.
        tune_rate: Adam's learning rate of them.
        consistent: what is found is made to agree with linear readings whose views are known (`consistency`).

    Raises:
        UserError: for a number out of range.

    Examples:
        >>> Search(starts=4).steps
        100
    """

    candidates: int = 256
    starts: int = 8
    steps: int = 100
    rate: float = 0.1
    prior: float = 0.02
    view_searches: int = 5
    tune: int = 30
    tune_rate: float = 3e-4
    consistent: bool = True

    def __post_init__(self) -> None:
        if self.candidates < 1:
            raise UserError(f"candidates={self.candidates}: give at least 1")
        if not 1 <= self.starts <= self.candidates:
            raise UserError(f"starts={self.starts}: give 1 to {self.candidates}, the number of candidates")
        for name in ("steps", "view_searches", "tune", "prior"):
            if not 0 <= getattr(self, name) < math.inf:
                raise UserError(f"{name}={getattr(self, name):g}: give 0 or more")
        for name in ("rate", "tune_rate"):
            if not 0 < getattr(self, name) <= MAX_RATE:
                raise UserError(f"{name}={getattr(self, name):g}: must be positive, and at most {MAX_RATE:g}")
