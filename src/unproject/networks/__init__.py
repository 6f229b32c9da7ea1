"""Generators, discriminators and view predictors."""

from .dcgan import DCGANDiscriminator
from .discriminators import Discriminator, LineDiscriminator, MultiScaleDiscriminator
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
    "MultiScaleDiscriminator",
    "SmoothImageGenerator",
    "StationaryMaterials",
    "TextureDiscriminator",
    "ViewPredictor",
    "VoxelGenerator",
]
