"""Training: recipes, the loop, run directories."""

from .coarse import Coarse
from .loop import resume, train
from .origin import make, rebuild, resumable
from .recipe import Adam, Options, Origin, Recipe
from .run import Run, load
from .tries import Tries
from .verdict import Verdict

__all__ = [
    "Adam",
    "Coarse",
    "Options",
    "Origin",
    "Recipe",
    "Run",
    "Tries",
    "Verdict",
    "load",
    "make",
    "rebuild",
    "resumable",
    "resume",
    "train",
]
