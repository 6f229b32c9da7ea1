"""
Materials
=========

Procedural wood, metal, plastic and fabric, a row each: diffuse albedo, specular albedo, roughness and normal map, and
the material under a lamp from the left and under coloured lamps.
"""

import torch

import unproject as up
from unproject.ops.microfacet import Reflection

makers = {up.data.wood: 3, up.data.metal: 2, up.data.plastic: 1, up.data.fabric: 6}
maps = torch.cat([make(1, 128, seed=seed) for make, seed in makers.items()])
albedo = Reflection("albedo")
light = {"view": torch.zeros(4), "light": torch.full((4,), 0.5), "light_azimuth": torch.full((4,), 3.14)}
lit = {lighting: up.Rendering(lighting, albedo)(maps, **light) for lighting in ("directional", "coloured")}
up.export.material_sheet(maps, lit, "runs/materials.png")
