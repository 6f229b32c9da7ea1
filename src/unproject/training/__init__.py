"""Training: recipes, the loop, run directories."""

from .loop import resume, train
from .recipe import Adam, Recipe
from .run_directory import Origin, Run, load

__all__ = ["Adam", "Origin", "Recipe", "Run", "load", "resume", "train"]
