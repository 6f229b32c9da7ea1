"""Turning images without blur: bicubic interpolation of their trigonometric interpolation, twice as fine.

Bilinear interpolation, as of `rotate_image`, takes detail away, more at some angles than at others: features of
turned digits then differ from those of upright ones by the blur, not by the turn.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

from .resampling import centres, in_single
from .rotation import cos_sin

FINER = 2


def turn_image(x: Tensor, angle: Tensor, reflected: Tensor | None = None) -> Tensor:
    """Rotate square images counter-clockwise, those that are `reflected` after exchanging left and right.

    Quarter turns are exact. What leaves the image is lost; outside it is 0, so that images should be 0 at their border.

    Args:
        x: (B, C, N, N); what is of half precision is turned in float32.
        angle: (B,) radians.
        reflected: (B,) bool (default: none).

    Returns:
        (B, C, N, N), within the range of each image.

    Examples:
        >>> import torch, unproject as up
        >>> digits = up.data.digits(32)[:9]
        >>> there = up.ops.turn_image(digits, torch.full((9,), torch.pi / 2))
        >>> torch.allclose(there, digits.rot90(1, (2, 3)), atol=1e-5)
        True
    """
    x = in_single(x)
    if reflected is not None:
        x = torch.where(reflected[:, None, None, None], x.flip(3), x)
    size = x.shape[3]
    fine = finer(F.pad(x, (size // 4,) * 4), FINER)
    c, s = (value[:, None, None] for value in cos_sin(angle.to(x)))
    right, down = centres(size, x) * size / 2, centres(size, x)[:, None] * size / 2  # pixels from the centre
    place = torch.stack((right * c - down * s, right * s + down * c), -1)
    # Sample i of the padded image is sample FINER i of the fine one, whose first and last samples are -1 and 1.
    middle = (size + 2 * (size // 4) - 1) / 2
    grid = 2 * FINER * (place + middle) / (fine.shape[3] - 1) - 1
    turned = F.grid_sample(fine, grid, mode="bicubic", align_corners=True)
    return torch.maximum(torch.minimum(turned, x.amax((1, 2, 3), keepdim=True)), x.amin((1, 2, 3), keepdim=True))


def finer(x: Tensor, times: int) -> Tensor:
    """Return images (..., H, W) at `times` as many places, by trigonometric interpolation: x[..., ::times] stays."""
    for axis in (-2, -1):
        count = x.shape[axis]
        spectrum = torch.fft.rfft(x, dim=axis)
        if count % 2 == 0:  # the highest frequency stands for itself and its negative
            spectrum = spectrum.index_copy(
                axis, torch.tensor([count // 2], device=x.device), spectrum.narrow(axis, count // 2, 1) / 2
            )
        x = torch.fft.irfft(spectrum, n=times * count, dim=axis) * times
    return x
