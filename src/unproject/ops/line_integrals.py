"""Line integrals of images: what a row of detectors, each as wide as its share of the picture, would measure.

A picture is W pixels wide and one unit long, its pixels are squares of constant value. Detector d of D, at an angle φ,
receives the mean over its width of the integrals along the lines through it:

    y[d] = D Σ_p x[p] area(pixel p ∩ strip d) = D/W² Σ_p x[p] (F(u_d+1 - c_p) - F(u_d - c_p)),   u_d = d/D - ½

with c_p = (position of p) · (cos φ, sin φ), and F(t) the share of a pixel's shadow left of t. The shadow of a square
is a trapezoid: a box as wide as the longer of its two edges appears, smoothed with one as wide as the shorter.
No sampling: of pictures made of pixels these integrals are exact, and nothing that falls on the detectors is lost.

References:
    Lo, S.-C. B. 1988, Strip and line path integrals with a square pixel matrix.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import torch
from torch import Tensor

from .rotation import cos_sin


def strip_integrals(image: Tensor, angle: Tensor, bins: int) -> Tensor:
    """(B, C, bins): the plain reference, with the area of every pixel in every strip.

    Args:
        image: (B, C, H, W), row 0 the top.
        angle: (B,) radians, from x (right) towards y (up): the direction in which the detectors lie.
        bins: D, detectors across one image width.
    """
    height, width = image.shape[2:]
    position, longer, shorter = (value[:, None] for value in _geometry(angle, height, width))
    edges = torch.arange(bins + 1, dtype=angle.dtype, device=angle.device)[None, :, None, None] / bins - 0.5
    left = edges - position + (longer + shorter)[..., None, None] / 2
    area = _shadow(left, longer[..., None, None], shorter[..., None, None]).diff(dim=1) / width**2
    return torch.einsum("bchw,bdhw->bcd", image, area) * bins


def strip_integrals_sparse(image: Tensor, angle: Tensor, bins: int) -> Tensor:
    """The same, from the few strips that each pixel touches; `angle` gets no gradient."""
    shadows = cast_shadows(angle.detach(), image.shape[2], image.shape[3], bins)
    return _Cast.apply(image.flatten(2), shadows, False) * (bins / image.shape[3] ** 2)


class Shadows(NamedTuple):
    """Where pixels fall: the share `shares[m]` (B, pixels) in bin `first + m`; bins are counted from `margin` early."""

    first: Tensor
    shares: tuple[Tensor, ...]
    bins: int
    margin: int


def cast_shadows(angle: Tensor, height: int, width: int, bins: int) -> Shadows:
    """The strips touched by each pixel of (height, width), and how much of it is in each."""
    position, longer, shorter = _geometry(angle, height, width)
    longer, shorter = (value[:, None, None] * bins for value in (longer, shorter))
    margin = math.ceil((math.hypot(height, width) / width - 1) / 2 * bins) + 1
    left = (position + 0.5) * bins - (longer + shorter) / 2
    edge = left.ceil()  # the first border between bins inside the shadow
    inside, touched = edge - left, math.floor(math.sqrt(2) * bins / width) + 2
    shares = [_shadow(inside + m, longer, shorter) for m in range(touched - 1)]
    shares = [shares[0], *(b - a for a, b in zip(shares, shares[1:], strict=False)), 1 - shares[-1]]
    first = edge.long() + (margin - 1)
    return Shadows(first.flatten(1), tuple(share.flatten(1) for share in shares), bins, margin)


class _Cast(torch.autograd.Function):
    """Pixels (B, C, pixels) to bins (B, C, D), or `back`, the transposed: each is the other's gradient."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, shadows: Shadows, back: bool) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx.shadows, ctx.back = shadows, back
        return (_cast_back if back else _cast)(values, shadows)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:  # pyright: ignore[reportIncompatibleMethodOverride]
        return _Cast.apply(gradient, ctx.shadows, not ctx.back), None, None


def _cast(pixels: Tensor, shadows: Shadows) -> Tensor:
    total = pixels.new_zeros(*pixels.shape[:2], shadows.bins + 2 * shadows.margin + len(shadows.shares))
    first = shadows.first[:, None].expand_as(pixels)
    for m, share in enumerate(shadows.shares):
        total[..., m:].scatter_add_(2, first, pixels * share[:, None])
    return total[..., shadows.margin : shadows.margin + shadows.bins]


def _cast_back(bins: Tensor, shadows: Shadows) -> Tensor:
    bins = torch.nn.functional.pad(bins, (shadows.margin, shadows.margin + len(shadows.shares)))
    first = shadows.first[:, None].expand(-1, bins.shape[1], -1)
    pixels = bins.gather(2, first) * shadows.shares[0][:, None]
    for m, share in enumerate(shadows.shares[1:], 1):
        pixels = pixels.addcmul(bins[..., m:].gather(2, first), share[:, None])
    return pixels


def _geometry(angle: Tensor, height: int, width: int) -> tuple[Tensor, Tensor, Tensor]:
    """(B, H, W) places of the pixels' centres along the detectors, and (B,) the two boxes of their shadows."""
    c, s = cos_sin(angle)
    x = ((torch.arange(width, dtype=angle.dtype, device=angle.device) * 2 + 1 - width) / (2 * width))[None, None]
    y = ((height - 1 - torch.arange(height, dtype=angle.dtype, device=angle.device) * 2) / (2 * width))[None, :, None]
    longer, shorter = torch.maximum(c.abs(), s.abs()) / width, torch.minimum(c.abs(), s.abs()) / width
    return x * c[:, None, None] + y * s[:, None, None], longer, shorter


def _shadow(t: Tensor, longer: Tensor, shorter: Tensor) -> Tensor:
    """The share of a shadow, box(longer) * box(shorter), that lies within t of its left end."""
    return (_ramp(t, shorter) - _ramp(t - longer, shorter)) / longer


def _ramp(t: Tensor, width: Tensor) -> Tensor:
    """∫ clamp(s / width, 0, 1) ds up to t; a width of 0 makes it max(t, 0)."""
    reached = torch.minimum(t.clamp(min=0), width)
    # reached ≤ width: the quotient is at most width / 2, so a tiny floor loses nothing.
    return t.clamp(min=0) - reached + reached.square() / (2 * width.clamp(min=1e-30))
