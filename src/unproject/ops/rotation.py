"""Rotation of volumes into the frame of a camera, and of images.

A camera at azimuth a and elevation e is in direction d of the object; right and up in its picture are r and u:

    r = (cos a, 0, -sin a)      d = (sin a cos e, sin e, cos a cos e)      u = d x r

The rotated volume is out[i, j, k] = x(i r + j u + k d), zero outside [-1, 1]³. What is of half precision is rotated in
float32, and stays float32: in bfloat16 an angle of 3 degrees would be none.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from .resampling import centres, in_single, sample_volume


def cos_sin(angle: Tensor) -> tuple[Tensor, Tensor]:
    """Return cos and sin of `angle`, rounding errors set to exactly 0, so that quarter turns are exact permutations."""
    return _snapped(angle.cos()), _snapped(angle.sin())


def _snapped(value: Tensor) -> Tensor:
    small = value.abs() < 8 * torch.finfo(value.dtype).eps
    return value - torch.where(small, value, torch.zeros_like(value)).detach()


def camera_frame(azimuth: Tensor, elevation: Tensor | None = None, roll: Tensor | None = None) -> Tensor:
    """Return the rows r (right), u (up), d (towards the camera) in the object's frame.

    Args:
        azimuth: (B,) radians.
        elevation: (B,) radians (default: 0).
        roll: (B,) radians by which the picture is turned counter-clockwise (default: 0): the camera turns clockwise,
            r cos - u sin is to its right, r sin + u cos is up.

    Returns:
        (B, 3, 3), orthonormal and right-handed.

    Examples:
        >>> import torch, unproject as up
        >>> frame = up.ops.camera_frame(torch.tensor([0.3]), torch.tensor([0.2]))[0]
        >>> torch.allclose(frame @ frame.T, torch.eye(3), atol=1e-6)
        True
    """
    ca, sa = cos_sin(azimuth)
    ce, se = cos_sin(torch.zeros_like(azimuth) if elevation is None else elevation)
    rows = (ca, torch.zeros_like(ca), -sa, -sa * se, ce, -ca * se, sa * ce, se, ca * ce)
    frame = torch.stack(rows, -1).unflatten(-1, (3, 3))
    return frame if roll is None else _rolled(frame, roll)


def _rolled(frame: Tensor, roll: Tensor) -> Tensor:
    c, s = (value[:, None] for value in cos_sin(roll))
    right, up, towards = frame.unbind(1)
    return torch.stack((right * c - up * s, right * s + up * c, towards), 1)


def rotate(x: Tensor, azimuth: Tensor, elevation: Tensor | None = None) -> Tensor:
    """Rotate volumes into the camera's frame by trilinear interpolation; zero outside.

    Differentiable in every argument.

    Args:
        x: (B, X, Y, Z).
        azimuth: (B,) radians.
        elevation: (B,) radians (default: 0).

    Returns:
        (B, X, Y, Z): first index to the picture's right, second up, third towards the camera.

    Examples:
        >>> import torch, unproject as up
        >>> up.ops.rotate(torch.rand(2, 8, 8, 8), torch.tensor([0.1, 0.2]), torch.tensor([0.0, 0.5])).shape
        torch.Size([2, 8, 8, 8])
    """
    if elevation is None:
        return rotate_y(x, azimuth)
    x = in_single(x)
    axes = torch.meshgrid(*(centres(n, x) for n in x.shape[1:]), indexing="ij")
    frame = camera_frame(azimuth, elevation)
    return sample_volume(x, torch.einsum("xyzk,bkj->bxyzj", torch.stack(axes, -1), frame.to(x)))


def rotate_y(x: Tensor, azimuth: Tensor) -> Tensor:
    """Rotate volumes (B, X, Y, Z) about y into the frame of a camera at `azimuth` (B,) and elevation 0.

    Every horizontal slice is rotated alike, so this is a 2-D rotation with the heights as channels.

    Examples:
        >>> import math, torch, unproject as up
        >>> x = torch.rand(1, 4, 4, 4)
        >>> torch.allclose(up.ops.rotate_y(x, torch.tensor([math.pi / 2])), up.ops.quarter_turn(x, 1), atol=1e-6)
        True
    """
    x = in_single(x)
    c, s = (value[:, None, None] for value in cos_sin(azimuth.to(x)))
    u, w = centres(x.shape[1], x)[:, None], centres(x.shape[3], x)
    grid = torch.stack((w * c - u * s, u * c + w * s), -1)
    slices = F.grid_sample(x.transpose(1, 2), grid, align_corners=False)
    return slices.transpose(1, 2)


def quarter_turn(x: Tensor, k: int) -> Tensor:
    """Return `rotate_y` at azimuth k 90°, as an index permutation."""
    return torch.rot90(x, k, (1, 3))


def reflect_x(x: Tensor) -> Tensor:
    """Return the mirror image: x replaced by -x."""
    return x.flip(1)


def rotate_image(x: Tensor, angle: Tensor) -> Tensor:
    """Rotate images (B, C, H, W) counter-clockwise by `angle` (B,), radians, by bilinear interpolation; zero outside.

    Examples:
        >>> import torch, unproject as up
        >>> up.ops.rotate_image(torch.rand(2, 1, 8, 8), torch.tensor([0.0, 0.5])).shape
        torch.Size([2, 1, 8, 8])
    """
    x, (height, width) = in_single(x), x.shape[2:]
    c, s = (value[:, None, None] for value in cos_sin(angle.to(x)))
    right, down = centres(width, x) * width, centres(height, x)[:, None] * height
    grid = torch.stack(((right * c - down * s) / width, (right * s + down * c) / height), -1)
    return F.grid_sample(x, grid, align_corners=False)
