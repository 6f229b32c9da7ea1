"""Networks: generators, discriminators, view predictors."""

from .discriminators import Discriminator, Standardised
from .generators import Generator, ImageGenerator, LowRankGenerator, VoxelGenerator
from .view_predictor import ViewPredictor

__all__ = [
    "Discriminator",
    "Generator",
    "ImageGenerator",
    "LowRankGenerator",
    "Standardised",
    "ViewPredictor",
    "VoxelGenerator",
]
