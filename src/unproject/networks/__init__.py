"""Networks: generators, discriminators, view predictors."""

from .dcgan import DCGANDiscriminator
from .discriminators import Discriminator, LineDiscriminator
from .generators import Generator, ImageGenerator, LowRankGenerator, VoxelGenerator
from .materials import DCGANMaterials, SmoothMaterials
from .view_predictor import ViewPredictor

__all__ = [
    "DCGANDiscriminator",
    "DCGANMaterials",
    "Discriminator",
    "Generator",
    "ImageGenerator",
    "LineDiscriminator",
    "LowRankGenerator",
    "SmoothMaterials",
    "ViewPredictor",
    "VoxelGenerator",
]
