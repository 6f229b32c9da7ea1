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
from ctypes import c_int64
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ._native import kernel, pointer
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
    return _Cast.apply(image, shadows, False) * (bins / image.shape[3] ** 2)


def strip_integrals_native(image: Tensor, angle: Tensor, bins: int) -> Tensor:
    """The same on a processor by `line_integrals.cpp`, or by `strip_integrals_sparse` where that cannot be compiled."""
    if _kernel(image, False) is None:
        return strip_integrals_sparse(image, angle, bins)
    return _Native.apply(image, torch.stack(cos_sin(angle.detach().to(image))), image.shape[2:], bins, False)


def _kernel(x: Tensor, back: bool) -> Any:
    return kernel(
        "line_integrals", f"look{'_back' if back else ''}_{'double' if x.dtype == torch.float64 else 'float'}"
    )


class _Native(torch.autograd.Function):
    """Images (B, C, H, W) to detectors (B, C, D), or `back`, the transposed: each is the other's gradient."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, turned: Tensor, size: Any, bins: int, back: bool) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx.save_for_backward(turned)
        ctx.rest = size, bins, not back
        values = values.contiguous()
        result = values.new_empty(*values.shape[:2], *(size if back else (bins,)))
        image, out = (result, values) if back else (values, result)
        _kernel(values, back)(
            pointer(image), pointer(turned[0]), pointer(turned[1]), pointer(out),
            *map(c_int64, (*values.shape[:2], *size, bins)),
        )  # fmt: skip
        return result

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Any:  # pyright: ignore[reportIncompatibleMethodOverride]
        return _Native.apply(gradient, *ctx.saved_tensors, *ctx.rest), None, None, None, None


class Shadows(NamedTuple):
    """Where pixels fall: the share `shares[m]` (B, pixels) in place `first + m` of a table.

    A row of the table is an image's, `stride` places: `margin` for what falls beside the detectors, the `bins`, and
    more for what falls beside. Of an image with an even number of rows these are the pixels of the upper half: the
    pixel opposite to another through the centre falls into the bins on the other side, in the same shares.
    """

    first: Tensor
    shares: tuple[Tensor, ...]
    size: tuple[int, int]
    bins: int
    margin: int
    stride: int

    @property
    def halved(self) -> bool:
        return self.size[0] % 2 == 0


def cast_shadows(angle: Tensor, height: int, width: int, bins: int) -> Shadows:
    """The strips touched by each pixel of (height, width), and how much of it is in each."""
    position, longer, shorter = _geometry(angle, height, width)
    longer, shorter = (value[:, None, None] * bins for value in (longer, shorter))
    margin = math.ceil((math.hypot(height, width) / width - 1) / 2 * bins) + 1
    rows = height // 2 if height % 2 == 0 else height
    left = torch.add(0.5 * bins - (longer + shorter) / 2, position[:, :rows], alpha=bins)
    edge = left.ceil()  # the first border between bins inside the shadow
    inside, touched = edge - left, math.floor(math.sqrt(2) * bins / width) + 2
    if bins == width:
        shares = _three_shares(inside, longer, shorter)
    else:
        within = [_shadow(inside + m, longer, shorter) for m in range(touched - 1)]
        shares = (within[0], *(b - a for a, b in zip(within, within[1:], strict=False)), 1 - within[-1])
    stride = bins + 2 * margin + len(shares)
    start = torch.arange(len(angle), device=angle.device) * stride + (margin - 1)
    first = (edge.long() + start[:, None, None]).view(-1)
    return Shadows(first, tuple(share.flatten(1) for share in shares), (height, width), bins, margin, stride)


def _three_shares(inside: Tensor, longer: Tensor, shorter: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """The shares of a shadow in three bins of one pixel's width, its left end `inside` [0, 1) before a border.

    As in `_shadow`, without what cannot be: longer² + shorter² is 1, so the first border is less than `shorter`
    beyond the longer box, and the second, 1 later, as near to the right end.
    """
    scale = 1 / longer
    curve = scale / (2 * shorter.clamp(min=1e-30))
    rising = torch.minimum(inside, shorter)
    before = (rising * curve).sub_(scale).mul_(rising).addcmul_(inside, scale)
    beyond = (inside - longer).clamp_(min=0)
    before.addcmul_(beyond.square_(), curve, value=-1)
    left_over = (longer + shorter - 1 - inside).clamp_(min=0)
    after = left_over.square_().mul_(curve)
    return before, (1 - before).sub_(after), after


class _Cast(torch.autograd.Function):
    """Images (B, C, H, W) to bins (B, C, D), or `back`, the transposed: each is the other's gradient."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, shadows: Shadows, back: bool) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        ctx.shadows, ctx.back = shadows, back
        return (_cast_back if back else _cast)(values, shadows)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:  # pyright: ignore[reportIncompatibleMethodOverride]
        return _Cast.apply(gradient, ctx.shadows, not ctx.back), None, None


def _cast(image: Tensor, shadows: Shadows) -> Tensor:
    return torch.stack([_cast_channel(channel, shadows) for channel in image.unbind(1)], 1)


def _cast_back(bins: Tensor, shadows: Shadows) -> Tensor:
    return torch.stack([_cast_channel_back(channel, shadows) for channel in bins.unbind(1)], 1)


def _cast_channel(image: Tensor, shadows: Shadows) -> Tensor:
    """(B, H, W) to (B, D)."""
    if not shadows.halved:
        return _scatter(image, shadows)
    upper, lower = image.chunk(2, 1)
    return _scatter(upper, shadows) + _scatter(lower.flip(1, 2), shadows).flip(1)


def _cast_channel_back(bins: Tensor, shadows: Shadows) -> Tensor:
    """(B, D) to (B, H, W)."""
    if not shadows.halved:
        return _gather(bins, shadows)
    return torch.cat([_gather(bins, shadows), _gather(bins.flip(1), shadows).flip(1, 2)], 1)


def _scatter(pixels: Tensor, shadows: Shadows) -> Tensor:
    pixels = pixels.flatten(1)
    total = pixels.new_zeros(len(pixels) * shadows.stride + len(shadows.shares))
    for m, share in enumerate(shadows.shares):
        # Flat: scattering along the last of several dimensions is several times slower.
        total[m:].scatter_add_(0, shadows.first, (pixels * share).view(-1))
    rows = total[: len(pixels) * shadows.stride].view(len(pixels), -1)
    return rows[:, shadows.margin : shadows.margin + shadows.bins]


def _gather(bins: Tensor, shadows: Shadows) -> Tensor:
    total = bins.new_zeros(len(bins) * shadows.stride + len(shadows.shares))
    rows = total[: len(bins) * shadows.stride].view(len(bins), -1)
    rows[:, shadows.margin : shadows.margin + shadows.bins] = bins
    pixels = total.index_select(0, shadows.first).view_as(shadows.shares[0]).mul_(shadows.shares[0])
    for m, share in enumerate(shadows.shares[1:], 1):
        pixels.addcmul_(total[m:].index_select(0, shadows.first).view_as(share), share)
    return pixels.view(len(bins), -1, shadows.size[1])


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
