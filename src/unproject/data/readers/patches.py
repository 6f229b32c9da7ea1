"""Thousands of training patches from a few large materials: cropped, turned, mirrored and scaled.

A patch is a square of the source, its axes turned by an angle and perhaps mirrored; a normal is turned with its axes:
n' = Rᵀ n, where R takes the patch's axes to the source's. Where a patch shrinks the source, that is averaged before.
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor

from ..._random import generator_at
from ..._types import UserError
from ...ops.lengths import length
from ...ops.maps import check_maps, places, unpack_maps
from .found import MAX_SIDE


def side_to_cut_from(size: int) -> int:
    """Return at how many pixels a side texture sets are read for patches to be cut out of them: 4 times as many."""
    return min(4 * size, MAX_SIDE)


def material_patches(
    materials: Tensor,
    count: int,
    size: int = 64,
    seed: int = 0,
    smallest: float = 0.25,
    largest: float = 0.65,
    turn: float = math.pi,
) -> Tensor:
    """(count, 8, size, size) of materials (N, 8, H, W), or 10 of 10 channels: patch k is a function of (seed, k).

    Args:
        smallest, largest: sides of the squares, as a part of the shorter side of the source.
        turn: angles are within ± so many radians; a quarter turn or more needs squares of at most 1/√2 of the source.

    Raises:
        UserError: for no patches, sides that do not fit into the source, or what is no material.
    """
    unpack_maps(materials)
    reach = math.cos(min(turn, math.pi / 4)) + math.sin(min(turn, math.pi / 4))
    if count < 1 or not 0 < smallest <= largest or largest * reach > 1 + 1e-9:
        raise UserError(
            f"patches: {count} of sides {smallest:g} to {largest:g}, turned by up to {math.degrees(turn):g}°; give at "
            f"least one, and sides of at most {1 / reach:.3g} of the source so that they fit"
        )
    drawn = torch.stack([torch.rand(6, generator=generator_at(seed, k, "patches")) for k in range(count)])
    pyramids = _pyramid(materials)
    which = (drawn[:, 0] * len(materials)).long()
    side = smallest + (largest - smallest) * drawn[:, 1]
    level = (side * min(materials.shape[2:]) / size).log2().floor().long().clamp(0, len(pyramids) - 1)
    patches = torch.empty(count, materials.shape[1], size, size)
    for k in range(count):
        source = pyramids[int(level[k])][which[k]][None]
        patches[k] = _patch(source, side[k], drawn[k, 2:], size, turn)[0]
    return check_maps(patches, "patches")


def _pyramid(materials: Tensor) -> list[Tensor]:
    """The materials, and each time half as large."""
    levels = [materials]
    while min(levels[-1].shape[2:]) >= 4:
        levels.append(F.avg_pool2d(levels[-1], 2))
    return levels


def _patch(source: Tensor, side: Tensor, drawn: Tensor, size: int, turn: float) -> Tensor:
    """One square of (1, 8 or 10, H, W); `drawn` in [0, 1): its place, its angle, and whether it is mirrored."""
    height, width = source.shape[2:]
    angle, mirror = (2 * drawn[2] - 1) * turn, -1.0 if drawn[3] < 0.5 else 1.0
    c, s = angle.cos(), angle.sin()
    axes = torch.stack([torch.stack([mirror * c, -s]), torch.stack([mirror * s, c])])  # columns: the patch's x and y
    half = side * min(height, width) / 2 * torch.tensor([1 / width, 1 / height])  # in widths and heights of the source
    room = 0.5 - half * (c.abs() + s.abs())
    centre = (2 * drawn[:2] - 1) * room.clamp(min=0)
    at = (torch.arange(size) * 2 + 1 - size) / size
    square = torch.stack([at.expand(size, size), -at[:, None].expand(size, size)], -1)  # x right, y up
    place = centre + (square @ axes.T) * half
    grid = torch.stack([2 * place[..., 0], -2 * place[..., 1]], -1)[None]
    seen = F.grid_sample(source, grid, padding_mode="border", align_corners=False)
    normal = seen[:, places(seen.shape[1])["normal"]]
    normal[:, :2] = torch.einsum("ji,bjhw->bihw", axes, normal[:, :2])
    normal[:, 2].clamp_(min=1e-3)
    normal /= length(normal, 1)
    return seen
