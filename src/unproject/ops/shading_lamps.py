"""`shading.shade` of lamps, by dot products alone: the same radiance in a fraction of the time.

A distant lamp needs no samples, and no frame of the normal. With h = (ωi + ωo) / |ωi + ωo| the reflection depends on
n·ωi, n·ωo, n·h, |n × h| and ωo·h only. They are computed as planes (B, L, H, W) of L lamps at a time, and what belongs
to the camera once for all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from torch import Tensor

from .differences import EPSILON
from .lights import Directional
from .maps import unpack_maps
from .microfacet import LEAST_ROUGHNESS, TINY, Reflection


def shade_lamps(maps: Tensor, to_camera: Tensor, light: Directional, reflection: Reflection) -> Tensor:
    """Compute the radiance (B, 3, H, W) of maps (B, 8, H, W) or (B, 10, H, W) under one lamp, or one for each colour.

    Args:
        maps: of one or three specular channels.
        to_camera: (B, 3, H, W), unit vectors from each texel to the camera.
        light: unit vectors (B, 3) or (B, 3, 3) towards the lamps.
        reflection: the reflection model.
    """
    named = unpack_maps(maps)
    k_d, k_s, m = named["diffuse"], named["specular"], named["roughness"].clamp(min=LEAST_ROUGHNESS)
    normal = named["normal"]
    n = normal / normal.square().sum(1, keepdim=True).clamp(min=EPSILON).sqrt()
    lamps = light.direction.to(maps).view(len(maps), -1, 3)

    h = [lamps[..., k, None, None] + to_camera[:, k : k + 1] for k in range(3)]
    length = _dot(h, h).clamp(min=TINY**2).sqrt()
    h = [component / length for component in h]
    normals, camera = n.split(1, 1), to_camera.split(1, 1)
    cos_o, cos_h = _dot(normals, camera), _dot(normals, h)
    cos_i = (lamps @ n.flatten(2)).view(*lamps.shape[:2], *maps.shape[2:])
    # |n × h|², not 1 - (n·h)², which loses all digits where m is small.
    across = [normals[a] * h[b] - normals[b] * h[a] for a, b in ((0, 1), (1, 2), (2, 0))]
    tan2 = _dot(across, across) / cos_h.square().clamp(min=TINY**2)

    lobe = reflection.lobe_of(k_s, m, cos_i, cos_o, cos_h, tan2, _dot(camera, h))
    return reflection.base(k_d, k_s, cos_o) * cos_i.clamp(min=0) + math.pi * lobe


def _dot(a: Sequence[Tensor], b: Sequence[Tensor]) -> Tensor:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
