"""Generators, discriminators and view predictors."""

from .dcgan import DCGANDiscriminator
from .discriminators import Discriminator, LineDiscriminator
from .generators import Generator, ImageGenerator, SmoothImageGenerator, VoxelGenerator
from .low_rank import LowRankGenerator
from .materials import DCGANMaterials, StationaryMaterials
from .textures import TextureDiscriminator
from .view_predictor import ViewPredictor

__all__ = [
    "DCGANDiscriminator",
    "DCGANMaterials",
    "Discriminator",
    "Generator",
    "ImageGenerator",
    "LineDiscriminator",
    "LowRankGenerator",
    "SmoothImageGenerator",
    "StationaryMaterials",
    "TextureDiscriminator",
    "ViewPredictor",
    "VoxelGenerator",
]
