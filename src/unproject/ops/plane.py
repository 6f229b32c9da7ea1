"""A pinhole camera aimed at the centre of a flat material one unit wide, in the plane z = 0.

At (θ, φ) and a distance d the camera is at d (sinθ cosφ, sinθ sinφ, cosθ). At φ = -90° and θ = 0, y is up in the
picture.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor

from .lengths import unit

BAND = 32  # rows of a picture computed at once


def towards(theta: Tensor, phi: Tensor) -> Tensor:
    """Return unit vectors (B, 3) of polar angle θ from z and azimuth φ from x towards y."""
    return torch.stack([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()], -1)


def texels(height: int, width: int, like: Tensor) -> Tensor:
    """Return the centres (3, H, W) of the texels, row 0 at the top (largest y)."""
    x = (2 * torch.arange(width, dtype=like.dtype, device=like.device) + 1 - width) / (2 * width)
    y = (height - 1 - 2 * torch.arange(height, dtype=like.dtype, device=like.device)) / (2 * width)
    return torch.stack(
        [x.expand(height, width), y[:, None].expand(height, width), torch.zeros_like(x).expand(height, width)]
    )


def to_camera(theta: Tensor, phi: Tensor, distance: float, height: int, width: int) -> Tensor:
    """Return unit vectors (B, 3, H, W) from each texel to the camera."""
    place = distance * towards(theta, phi)
    direction = place[:, :, None, None] - texels(height, width, theta)
    return unit(direction, 1)


def photograph(
    picture: Tensor,
    theta: Tensor,
    phi: Tensor,
    distance: float,
    repeat: bool = False,
    shade: Callable[[Tensor, Tensor, int], Tensor] | None = None,
) -> Tensor:
    """Project images (B, C, H, W) on the plane to pictures of the same size, each pixel the mean of rays through it.

    At θ = 0 the material fills the picture. Outside the material the value is 0, or with `repeat` the plane is tiled up
    to the horizon. A pixel has up to 8 × 8 rays, as the strongest foreshortening needs.

    Args:
        shade: (what is seen along rays (1, C, h, w), directions to the camera (1, 3, h, w), the row of B) → what is
            averaged in its place: no two tiles of a plane look the same under a light.
    """
    seen = []
    for k, (one, t, p) in enumerate(zip(picture[:, None], theta[:, None], phi[:, None], strict=True)):
        at_row = None if shade is None else _of_row(shade, k)
        fine = int((1 / t.detach().cos().abs().clamp(min=1 / 8)).ceil())
        rays = texels(picture.shape[2] * fine, picture.shape[3] * fine, theta)[:2] / distance
        # In bands of rows, so that a large picture does not need fine² times its memory.
        bands = [_seen(one, t, p, distance, band, repeat, fine, at_row) for band in rays.split(BAND * fine, 1)]
        seen.append(torch.cat(bands, 2))
    return torch.cat(seen) if seen else picture


def _of_row(shade: Callable[[Tensor, Tensor, int], Tensor], row: int) -> Callable[[Tensor, Tensor], Tensor]:
    return lambda seen, camera: shade(seen, camera, row)


def _seen(
    picture: Tensor,
    theta: Tensor,
    phi: Tensor,
    distance: float,
    rays: Tensor,
    repeat: bool,
    fine: int,
    shade: Callable[[Tensor, Tensor], Tensor] | None,
) -> Tensor:
    """Return the part (1, C, h, w) of the picture of rays (2, h · fine, w · fine), given by tangents from the axis."""
    height, width = picture.shape[2:]
    right = torch.stack([-phi.sin(), phi.cos(), torch.zeros_like(phi)], -1)[:, None, None]
    back = towards(theta, phi)[:, None, None]
    up = torch.linalg.cross(back, right)
    direction = rays[0, ..., None] * right + rays[1, ..., None] * up - back
    reach = distance * back[..., 2] / (-direction[..., 2]).clamp(min=1e-6)
    hit = distance * back + reach[..., None] * direction
    x, y = hit[..., 0], hit[..., 1] * (width / height)
    seen = (direction[..., 2] < -1e-6) & (repeat | ((x.abs() <= 0.5) & (y.abs() <= 0.5)))
    if repeat:
        x, y = x - x.round(), y - y.round()
        picture = F.pad(picture, (1, 1, 1, 1), mode="circular")
        x, y = x * (width / (width + 2)), y * (height / (height + 2))
    grid = torch.stack([2 * x, -2 * y], -1)
    sampled = F.grid_sample(picture, grid.to(picture), padding_mode="border", align_corners=False)
    if shade is not None:
        sampled = shade(sampled, -F.normalize(direction.to(picture), dim=-1).permute(0, 3, 1, 2))
    return F.avg_pool2d(sampled * seen[:, None].to(picture), fine)
