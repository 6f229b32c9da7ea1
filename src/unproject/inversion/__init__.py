"""Inversion: the samples of a generator whose projections are given pictures."""

from __future__ import annotations

from .fit import Fit
from .fitter import Fitter
from .latent_space import LatentSpace
from .novelty import DOUBTFUL, Novelty
from .search import Search
from .viewing import Viewing

__all__ = ["DOUBTFUL", "Fit", "Fitter", "LatentSpace", "Novelty", "Search", "Viewing"]
