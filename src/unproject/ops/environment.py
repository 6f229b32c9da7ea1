"""Distant light: environments as lat-long maps, their lookup, importance sampling and exposure.

Row 0 of a map is at the surface normal z, the columns run φ = 0 … 2π; pixel centres lie at (column + ½)/W and
(row + ½)/H. Radiance is bilinear between them, hence differentiable in the direction. Directions are drawn from the
bilinear density

    p(ω) = w(φ, θ) H W / (2π² sinθ Σ w),      w = mean over colours of L · sinθ · max(cosθ, 1/20)

by choosing a texel in proportion to w, and a place in it with a triangular density along each axis.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from .._types import UserError

LEAST_SINE = 1e-4
GRAZING = 0.05  # least cosine in w: tilted normals receive light from below the horizon too


class Environments(NamedTuple):
    """K prepared maps: `table` (K, H, W, 4), radiance and p(ω) sinθ; `running` (K, H W), cumulative sums of w / Σ w."""

    table: Tensor
    running: Tensor

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the maps."""
        return self.table.shape[1], self.table.shape[2]


def prepare_environments(radiance: Tensor) -> Environments:
    """Prepare environments of radiance (K, 3, H, W) for lookup and sampling.

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
    """Return cosθ and sinθ of the rows' centres."""
    theta = (torch.arange(radiance.shape[2], dtype=radiance.dtype, device=radiance.device) + 0.5) * (
        math.pi / radiance.shape[2]
    )
    return theta.cos(), theta.sin()


def solid_angles(height: int, width: int) -> Tensor:
    """Return the solid angles (H, W) of the texels of a lat-long map, float64; their sum is 4π.

    Examples:
        >>> round(solid_angles(8, 16).sum().item(), 4)
        12.5664
    """
    edges = torch.cos(torch.arange(height + 1, dtype=torch.float64) * (math.pi / height))
    return ((edges[:-1] - edges[1:]) * (2 * math.pi / width))[:, None].expand(height, width)


def exposure(radiance: Tensor) -> Tensor:
    """Return the factor (K,) that scales the light of the upper hemisphere to that of an ambient radiance of 1.

    2π / ∫_{upper} L dω, L the mean over colours: the paper's auto-exposure. It is 1 for ambient and directional light
    by definition, and for a map without light from above.

    Args:
        radiance: (K, 3, H, W).
    """
    height, width = radiance.shape[2:]
    above = (height - 2 * torch.arange(height, dtype=torch.float64)).clamp(0, 2)[:, None] / 2  # the middle row has ½
    weights = (solid_angles(height, width) * above).to(radiance.device)
    total = (radiance.double().mean(1) * weights).sum((1, 2))
    return torch.where(total > 0, 2 * math.pi / total, torch.ones_like(total)).to(radiance)


def surface_exposure(radiance: Tensor) -> Tensor:
    """Return the factor (K,) that scales the light on a flat surface, facing z, to that of an ambient radiance of 1.

    π / ∫_{upper} L cosθ dω, L the mean over colours: what a camera meters that sees the surface only. It is 1 for a map
    without light from above.

    Args:
        radiance: (K, 3, H, W).
    """
    height, width = radiance.shape[2:]
    edges = torch.cos(torch.arange(height + 1, dtype=torch.float64) * (math.pi / height)).clamp(min=0)
    weights = ((edges[:-1].square() - edges[1:].square()) * (math.pi / width)).to(radiance.device)
    total = (radiance.double().mean(1).sum(2) * weights).sum(1)
    return torch.where(total > 0, math.pi / total, torch.ones_like(total)).to(radiance)


def look_up(environments: Environments, which: Tensor, turn: Tensor, direction: Tensor) -> tuple[Tensor, Tensor]:
    """Return radiance (..., 3) and density (...) in a direction (B, ..., 3).

    Args:
        environments: K prepared maps.
        which: (B,) int64, the map of each batch element.
        turn: (B,) radians, the rotation of the map about z.
        direction: (B, ..., 3) unit vectors.
    """
    height, width = environments.size
    lift = (slice(None), *[None] * (direction.dim() - 2))
    x, y, z = direction.unbind(-1)
    away = x.square() + y.square() > 1e-14  # at the pole the azimuth has no gradient
    z = z.clamp(-1 + 1e-7, 1 - 1e-7)
    azimuth = torch.atan2(torch.where(away, y, 0), torch.where(away, x, 1)) - turn[lift]
    column = azimuth * (width / (2 * math.pi)) - 0.5
    row = (torch.acos(z) * (height / math.pi) - 0.5).clamp(0, height - 1)
    left, upper = column.floor(), row.floor().clamp(max=height - 2)
    value = _bilinear(environments.table, which[lift], left.long(), upper.long(), column - left, row - upper)
    sin = (1 - z.square()).sqrt().clamp(min=LEAST_SINE)
    return value[..., :3], value[..., 3] / sin


def _bilinear(table: Tensor, which: Tensor, left: Tensor, upper: Tensor, across: Tensor, down: Tensor) -> Tensor:
    """Interpolate a table (K, H, W, 4), periodic from left to right, to (..., 4)."""
    _, height, width, _ = table.shape
    flat = table.view(-1, 4)
    start = (which * height + upper) * width
    left, right = left % width, (left + 1) % width
    across, down = across[..., None], down[..., None]
    above = flat[start + left] * (1 - across) + flat[start + right] * across
    below = flat[start + width + left] * (1 - across) + flat[start + width + right] * across
    return above * (1 - down) + below * down


def sample_environments(environments: Environments, which: Tensor, turn: Tensor, u: Tensor) -> Tensor:
    """Draw directions (B, M, 3) with the density that `look_up` returns, from u (B, M, 3) in [0, 1)."""
    height, width = environments.size
    texel = torch.searchsorted(environments.running[which], u[..., 0].contiguous(), right=True)
    texel = texel.clamp(max=height * width - 1)
    row = texel // width + 0.5 + _tent(u[..., 1])
    # Above the centre of the first row density and radiance are constant; rows beyond the pole are reflected.
    row = torch.where(row > height, 2 * height - row, row.abs())
    theta = row * (math.pi / height)
    phi = (texel % width + 0.5 + _tent(u[..., 2])) * (2 * math.pi / width) + turn[:, None]
    sin = theta.sin()
    return torch.stack([sin * phi.cos(), sin * phi.sin(), theta.cos()], -1)


def _tent(u: Tensor) -> Tensor:
    """Map uniform u to the triangular density on [-1, 1]."""
    return torch.where(u < 0.5, (2 * u).sqrt() - 1, 1 - (2 - 2 * u).clamp(min=0).sqrt())
