"""Procedural data sets of surface materials: `wood`, `metal`, `plastic`, `fabric` and `correlated`, of any length.

Maps (N, 8, S, S) as `ops.maps` packs them, or (N, 10, S, S) with a `coloured` specular albedo, for `fresnel="albedo"`:
k_s is the reflectance at normal incidence itself, m the RMS slope of Beckmann, colours linear. Item k of a seed
depends on (seed, k) and on the size alone, to the last bit: items are made in blocks of 16, whole ones always, because
sums may round otherwise in a batch of another length. Another number of threads may change the last bits, by some 1e-5.

    wood          grain along y; tiles along the grain, and across where boards have gaps
    metal         brushed and ribbed ones run along x, the rest has no direction; tiles
    plastic       ribs run along x or y, the rest has no direction; tiles
    fabric        warp, wales and stripes run along y; tiles
    correlated    no direction; tiles
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from torch import Tensor

from ...._types import UserError
from ....ops.maps import check_maps, with_specular
from .correlated import CHANCES as CORRELATED
from .correlated import build_correlated
from .fabric import CHANCES as FABRIC
from .fabric import build_fabric
from .metal import CHANCES as METAL
from .metal import build_metal
from .noise import Chances, Draws, draw
from .plastic import CHANCES as PLASTIC
from .plastic import build_plastic
from .wood import CHANCES as WOOD
from .wood import build_wood

BLOCK = 16
SMALLEST, LARGEST = 16, 1024


def wood(count: int, size: int = 64, seed: int = 0, *, coloured: bool = False) -> Tensor:
    """The first `count` woods of a seed, (count, 8, size, size); see `wood.py`.

    Args:
        count: of materials.
        size: side of the maps.
        seed: of the data set.
        coloured: give the specular albedo three channels, (count, 10, size, size): metals have their colour there, what
            reflects no colour has three equal ones.

    Raises:
        UserError: for a count below 1 or a size that is not within 16 and 1024.
    """
    return build(WOOD, build_wood, count, size, seed, coloured)


def metal(count: int, size: int = 64, seed: int = 0, *, coloured: bool = False) -> Tensor:
    """The first `count` metals of a seed, (count, 8, size, size); see `metal.py`. Arguments and errors: `wood`.

    Examples:
        >>> import unproject as up
        >>> up.data.metal(2, 16, coloured=True).shape
        torch.Size([2, 10, 16, 16])
    """
    return build(METAL, partial(build_metal, coloured=coloured), count, size, seed, coloured)


def plastic(count: int, size: int = 64, seed: int = 0, *, coloured: bool = False) -> Tensor:
    """The first `count` plastics of a seed, (count, 8, size, size); see `plastic.py`. Arguments and errors: `wood`."""
    return build(PLASTIC, build_plastic, count, size, seed, coloured)


def fabric(count: int, size: int = 64, seed: int = 0, *, coloured: bool = False) -> Tensor:
    """The first `count` fabrics of a seed, (count, 8, size, size); see `fabric.py`. Arguments and errors: `wood`."""
    return build(FABRIC, build_fabric, count, size, seed, coloured)


def correlated(
    count: int,
    size: int = 64,
    seed: int = 0,
    diffuse_normal: float = 0.9,
    specular_roughness: float = 0.9,
    *,
    coloured: bool = False,
) -> Tensor:
    """The first `count` materials whose maps are correlated by design, (count, 8, size, size); see `correlated.py`.

    Args:
        count: of materials.
        size: side of the maps.
        seed: of the data set.
        diffuse_normal: the correlation in each octave of the diffuse map's luminance and the normals' height.
        specular_roughness: that of specular and roughness. Across the two groups it is 0.
        coloured: as of `wood`.

    Raises:
        UserError: as `wood`, or for a correlation that is not within [-1, 1].
    """
    builder = partial(build_correlated, diffuse_normal=diffuse_normal, specular_roughness=specular_roughness)
    return build(CORRELATED, builder, count, size, seed, coloured)


def build(
    chances: Chances, builder: Callable[[Draws], Tensor], count: int, size: int, seed: int, coloured: bool = False
) -> Tensor:
    """The first `count` items of a data set, block by block."""
    if count < 1 or not SMALLEST <= size <= LARGEST:
        raise UserError(
            f"{chances.name}: give a count of at least 1 and a size of {SMALLEST} to {LARGEST}, not {count} and {size}"
        )
    blocks = [
        builder(draw(chances, range(first, first + BLOCK), size, seed))[: count - first]
        for first in range(0, count, BLOCK)
    ]
    return check_maps(with_specular(torch.cat(blocks), 3 if coloured else 1), chances.name)
