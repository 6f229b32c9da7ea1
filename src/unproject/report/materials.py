"""Materials for the page's viewer: maps in 8 bits, and the formula by which light.js shades them.

    L = k_b cosθi + π lobe,   k_b = the diffuse base,   lobe = k_s/4 D G1(ωi) G1(ωo) F / (cosθi cosθo) cosθi

of `ops.microfacet` under a directional light of irradiance π, developed with gamma 2.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch.nn.functional as F
from torch import Tensor

from ..domains import Maps
from ..ops.maps import are_maps, unpack_maps
from ..ops.microfacet import Reflection
from .numbers import encoded

COUNT, FINEST = 8, 128
"""Materials to choose from, and texels a side of each at most."""
DISTANCE = 4.0
"""Of the camera above the middle, in widths of the material."""


def material_data(maps: Tensor, domain: Maps, count: int = COUNT) -> dict[str, Any]:
    """Return what light.js shades: of each of the first maps (N, C, H, W) the texels, row 0 at the top, in base64.

    `colour` uint8 (H, W, 4) is the square root of diffuse albedo (3) and specular albedo (1) times 255, `relief` uint8
    (H, W, 4) is 127 n + 128 of the normal (3) and the square root of the slope m times 255 (1): square roots, since the
    eye sees steps at the dark end. Of a coloured specular albedo `colour` has the largest of its channels, and `tint`
    uint8 (H, W, 4) the square root of the albedo (3) times 255, and 255.
    """
    maps = maps[:count].float()
    times = -(-max(maps.shape[2:]) // FINEST)
    maps = F.avg_pool2d(maps, times) if times > 1 else maps
    named = {name: part.permute(0, 2, 3, 1).numpy() for name, part in unpack_maps(maps).items()}
    length = np.linalg.norm(named["normal"], axis=-1, keepdims=True)
    normal = named["normal"] / np.maximum(length, 1e-6)
    specular = named["specular"]
    colour = np.sqrt(np.clip(np.concatenate([named["diffuse"], specular.max(-1, keepdims=True)], -1), 0, 1))
    relief = np.concatenate([127 * normal + 128, 255 * np.sqrt(np.clip(named["roughness"], 0, 1))], -1)
    items = [
        {"name": f"sample {k}", "colour": encoded(255 * c, np.uint8), "relief": encoded(r, np.uint8)}
        for k, (c, r) in enumerate(zip(colour, relief, strict=True))
    ]
    if specular.shape[-1] == 3:
        tint = np.sqrt(np.clip(np.concatenate([specular, np.ones_like(specular[..., :1])], -1), 0, 1))
        items = [{**item, "tint": encoded(255 * t, np.uint8)} for item, t in zip(items, tint, strict=True)]
    height, width = maps.shape[2:]
    model = {"albedo": domain.fresnel == "albedo", "eta": Reflection().eta, "distance": DISTANCE}
    return {"kind": "materials", "width": width, "height": height, "model": model, "items": items}


def is_material(domain: object, x: Tensor) -> bool:
    """Whether these samples are maps that can be lit."""
    return isinstance(domain, Maps) and are_maps(x)
