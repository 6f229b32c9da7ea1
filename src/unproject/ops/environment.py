"""Distant light: environments as lat-long maps, their lookup, their importance sampling and their exposure.

Row 0 of a map is the surface normal z, the columns run φ = 0 … 2π; pixel centres lie at (column + ½)/W and (row + ½)/H.
Between them radiance is bilinear, so that it has a slope, and samples are drawn from exactly the bilinear density

    p(ω) = w(φ, θ) H W / (2π² sinθ Σ w),      w = mean over colours of L · sinθ · max(cosθ, 1/20)

a texel chosen in proportion to w and a place under its tent.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from .._types import UserError

LEAST_SINE = 1e-4
GRAZING = 0.05  # light from below the horizon still reaches tilted normals


class Environments(NamedTuple):
    """K maps made ready: (K, H, W, 4) radiance and p(ω) sinθ; (K, H W) the running sum of the texels' shares."""

    table: Tensor
    running: Tensor

    @property
    def size(self) -> tuple[int, int]:
        return self.table.shape[1], self.table.shape[2]


def prepare_environments(radiance: Tensor) -> Environments:
    """Of radiance (K, 3, H, W).

    Raises:
        UserError: for another shape, values that are not finite, negative ones, or a map without light.
    """
    if radiance.dim() != 4 or radiance.shape[1] != 3 or min(radiance.shape[2:]) < 2:
        raise UserError(
            f"environments: give radiance (K, 3, H, W) of two rows and columns at least, not {tuple(radiance.shape)}"
        )
    if not radiance.isfinite().all() or radiance.min() < 0:
        raise UserError("environments: radiance must be finite and not negative")
    cos, sin = _rows(radiance)
    brightest = radiance.amax((1, 2, 3)).clamp(min=1e-45)[:, None, None]
    weight = (radiance.double() / brightest[:, None].double()).mean(1) * (sin * cos.clamp(min=GRAZING))[:, None]
    total = weight.sum((1, 2), keepdim=True)
    if (total <= 0).any():
        raise UserError("environments: one of the maps is black; leave it out")
    share = weight / total
    density = (share * (weight[0].numel() / (2 * math.pi**2))).to(radiance)
    table = torch.cat([radiance.permute(0, 2, 3, 1), density[..., None]], -1).contiguous()
    return Environments(table, share.flatten(1).cumsum(1).to(radiance.dtype))


def _rows(radiance: Tensor) -> tuple[Tensor, Tensor]:
    """cosθ and sinθ of the rows' centres."""
    theta = (torch.arange(radiance.shape[2], dtype=radiance.dtype, device=radiance.device) + 0.5) * (
        math.pi / radiance.shape[2]
    )
    return theta.cos(), theta.sin()


def solid_angles(height: int, width: int) -> Tensor:
    """(H, W) of the texels, float64; they add up to 4π."""
    edges = torch.cos(torch.arange(height + 1, dtype=torch.float64) * (math.pi / height))
    return ((edges[:-1] - edges[1:]) * (2 * math.pi / width))[:, None].expand(height, width)


def exposure(radiance: Tensor) -> Tensor:
    """(K,): the factor that brings the light from the upper hemisphere to that of an ambient radiance of 1.

    2π / ∫_{upper} L dω, L the mean over colours: what the paper calls auto-exposure. Ambient and directional lights
    are at that exposure by definition. A map without light from above gets 1.
    """
    height, width = radiance.shape[2:]
    above = (height - 2 * torch.arange(height, dtype=torch.float64)).clamp(0, 2)[:, None] / 2  # an odd row counts half
    weights = (solid_angles(height, width) * above).to(radiance.device)
    total = (radiance.double().mean(1) * weights).sum((1, 2))
    return torch.where(total > 0, 2 * math.pi / total, torch.ones_like(total)).to(radiance)


def look_up(environments: Environments, which: Tensor, turn: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
    """Radiance (..., 3) and density (...) in a direction (B, ..., 3); `turn` (B,) turns the light about z."""
    height, width = environments.size
    lift = (slice(None), *[None] * (direction.dim() - 2))
    x, y, z = direction.unbind(-1)
    away = x.square() + y.square() > 1e-14  # at the pole the azimuth has no slope
    z = z.clamp(-1 + 1e-7, 1 - 1e-7)
    azimuth = torch.atan2(torch.where(away, y, 0), torch.where(away, x, 1)) - turn[lift]
    column = azimuth * (width / (2 * math.pi)) - 0.5
    row = (torch.acos(z) * (height / math.pi) - 0.5).clamp(0, height - 1)
    left, upper = column.floor(), row.floor().clamp(max=height - 2)
    value = _bilinear(environments.table, which[lift], left.long(), upper.long(), column - left, row - upper)
    sin = (1 - z.square()).sqrt().clamp(min=LEAST_SINE)
    return value[..., :3], value[..., 3] / sin


def _bilinear(table: Tensor, which: Tensor, left: Tensor, upper: Tensor, across: Tensor, down: Tensor) -> Tensor:
    """(..., 4) of a table (K, H, W, 4) that goes around from left to right."""
    _, height, width, _ = table.shape
    flat = table.view(-1, 4)
    start = (which * height + upper) * width
    left, right = left % width, (left + 1) % width
    across, down = across[..., None], down[..., None]
    above = flat[start + left] * (1 - across) + flat[start + right] * across
    below = flat[start + width + left] * (1 - across) + flat[start + width + right] * across
    return above * (1 - down) + below * down


def sample_environments(environments: Environments, which: Tensor, turn: Tensor, u: Tensor) -> Tensor:
    """(B, M, 3) directions with the density of `look_up`, of u (B, M, 3) in [0, 1)."""
    height, width = environments.size
    texel = torch.searchsorted(environments.running[which], u[..., 0].contiguous(), right=True)
    texel = texel.clamp(max=height * width - 1)
    row = texel // width + 0.5 + _tent(u[..., 1])
    # Above the first row's centre density is constant, as is radiance: what falls over the pole is folded back.
    row = torch.where(row > height, 2 * height - row, row.abs())
    theta = row * (math.pi / height)
    phi = (texel % width + 0.5 + _tent(u[..., 2])) * (2 * math.pi / width) + turn[:, None]
    sin = theta.sin()
    return torch.stack([sin * phi.cos(), sin * phi.sin(), theta.cos()], -1)


def _tent(u: Tensor) -> Tensor:
    """Triangular on [-1, 1]."""
    return torch.where(u < 0.5, (2 * u).sqrt() - 1, 1 - (2 - 2 * u).clamp(min=0).sqrt())
