"""Networks: generators, discriminators, view predictors."""

from .dcgan import DCGANDiscriminator
from .discriminators import Discriminator, LineDiscriminator
from .generators import Generator, ImageGenerator, LowRankGenerator, VoxelGenerator
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
    "StationaryMaterials",
    "TextureDiscriminator",
    "ViewPredictor",
    "VoxelGenerator",
]
