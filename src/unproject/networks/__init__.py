"""Networks: generators, discriminators, view predictors."""

from .discriminators import Discriminator, LineDiscriminator
from .generators import Generator, ImageGenerator, LowRankGenerator, VoxelGenerator
from .view_predictor import ViewPredictor

__all__ = [
    "Discriminator",
    "Generator",
    "ImageGenerator",
    "LineDiscriminator",
    "LowRankGenerator",
    "ViewPredictor",
    "VoxelGenerator",
]
