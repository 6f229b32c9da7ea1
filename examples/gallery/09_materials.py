"""
Materials
=========

Procedural wood, metal and plastic, a row each: diffuse albedo, specular albedo, roughness and normal map, and the
material under a lamp from the left and under coloured lamps.
"""

import torch

import unproject as up
from unproject.ops.microfacet import Reflection

maps = torch.cat([up.data.wood(1, 128, seed=3), up.data.metal(1, 128, seed=2), up.data.plastic(1, 128, seed=1)])
albedo = Reflection("albedo")
light = {"view": torch.zeros(3), "light": torch.full((3,), 0.5), "light_azimuth": torch.full((3,), 3.14)}
lit = [up.Rendering(lighting, albedo)(maps, **light) for lighting in ("directional", "coloured")]
up.export.material_sheet(maps, lit, "runs/materials.png")
