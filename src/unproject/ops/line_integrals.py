"""Line integrals of images, measured by a row of D equal detectors as wide as the image.

An image is W pixels and one unit wide; its pixels are squares of constant value. Detector d of D, at an angle φ,
measures the mean over its width of the integrals along the lines through it:

    y[d] = D Σ_p x[p] area(pixel p ∩ strip d) = D/W² Σ_p x[p] (F(u_d+1 - c_p) - F(u_d - c_p)),   u_d = d/D - ½

with c_p = (position of p) · (cos φ, sin φ), and F(t) the part of a pixel's footprint left of t. The footprint of a
square on the row of detectors is a trapezoid: a box as wide as the longer projection of its edges, convolved with one
as wide as the shorter. Nothing is sampled: for images of constant pixels the integrals are exact.

References:
    Lo, S.-C. B. 1988, Strip and line path integrals with a square pixel matrix.
"""

from __future__ import annotations

import math
from ctypes import c_int64
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ._native import gpu_kernels, kernel, pointer
from .rotation import cos_sin


def strip_integrals(image: Tensor, angle: Tensor, bins: int) -> Tensor:
    """Return line integrals (B, C, bins) from the area of every pixel in every strip: the plain reference.

    Args:
        image: (B, C, H, W), row 0 the top.
        angle: (B,) radians, from x (right) towards y (up): the direction in which the detectors lie.
        bins: D, detectors across one image width.

    Examples:
        >>> import math, torch, unproject as up
        >>> image = torch.zeros(1, 1, 4, 4)
        >>> image[..., 1] = 1  # the second column
        >>> up.ops.strip_integrals(image, torch.tensor([0.0]), bins=4)
        tensor([[[0., 1., 0., 0.]]])
        >>> up.ops.strip_integrals(image, torch.tensor([math.pi / 2]), bins=4)
        tensor([[[0.2500, 0.2500, 0.2500, 0.2500]]])
    """
    height, width = image.shape[2:]
    position, longer, shorter = (value[:, None] for value in _geometry(angle, height, width))
    edges = torch.arange(bins + 1, dtype=angle.dtype, device=angle.device)[None, :, None, None] / bins - 0.5
    left = edges - position + (longer + shorter)[..., None, None] / 2
    area = _shadow(left, longer[..., None, None], shorter[..., None, None]).diff(dim=1) / width**2
    return torch.einsum("bchw,bdhw->bcd", image, area) * bins


def strip_integrals_sparse(image: Tensor, angle: Tensor, bins: int) -> Tensor:
    """Return the values of `strip_integrals` from the few strips that each pixel overlaps; no gradient by `angle`."""
    known = angle.detach().isfinite()
    shadows = cast_shadows(torch.where(known, angle.detach(), 0), image.shape[2], image.shape[3], bins)
    sums = _Cast.apply(image, shadows, False) * (bins / image.shape[3] ** 2)
    return sums if bool(known.all()) else torch.where(known[:, None, None], sums, torch.nan)


def strip_integrals_native(image: Tensor, angle: Tensor, bins: int) -> Tensor:
    """Return `strip_integrals` by `line_integrals.cpp`, or `line_integrals_triton` on a GPU; without a compiler or
    Triton by `strip_integrals_sparse`."""
    known = image.dtype in (torch.float32, torch.float64)
    if not known or not _has_kernels(image):
        return strip_integrals_sparse(image, angle, bins)
    return _Native.apply(image, torch.stack(cos_sin(angle.detach().to(image))), image.shape[2:], bins, False)


def _has_kernels(image: Tensor) -> bool:
    if image.device.type == "cpu":
        return _kernel(image, False) is not None
    return gpu_kernels("line_integrals", image) is not None


def _kernel(x: Tensor, back: bool) -> Any:
    return kernel(
        "line_integrals", f"project{'_back' if back else ''}_{'double' if x.dtype == torch.float64 else 'float'}"
    )


class _Native(torch.autograd.Function):
    """Images (B, C, H, W) to detectors (B, C, D), or, with `back`, its transpose: each is the gradient of the other."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, turned: Tensor, size: Any, bins: int, back: bool) -> Tensor:
        ctx.save_for_backward(turned)
        ctx.rest = size, bins, not back
        values = values.contiguous()
        if values.is_cuda:
            return gpu_kernels("line_integrals", values).project(values, turned, size, bins, back)
        result = values.new_empty(*values.shape[:2], *(size if back else (bins,)))
        image, out = (result, values) if back else (values, result)
        _kernel(values, back)(
            pointer(image), pointer(turned[0]), pointer(turned[1]), pointer(out),
            *map(c_int64, (*values.shape[:2], *size, bins)),
        )  # fmt: skip
        return result

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> Any:
        return _Native.apply(gradient, *ctx.saved_tensors, *ctx.rest), None, None, None, None


class Shadows(NamedTuple):
    """The overlap of pixels and detectors: the part `shares[m]` (B, pixels) of a pixel in place `first + m` of a table.

    The table has `stride` places for each image: `margin` for what projects outside the detectors, the `bins`, and more
    for the outside. For an image with an even number of rows the pixels are those of the upper half: the pixel opposite
    through the centre projects to the mirrored bins, with the same shares.
    """

    first: Tensor
    shares: tuple[Tensor, ...]
    size: tuple[int, int]
    bins: int
    margin: int
    stride: int

    @property
    def halved(self) -> bool:
        """Whether only the pixels of the upper half are stored."""
        return self.size[0] % 2 == 0


def cast_shadows(angle: Tensor, height: int, width: int, bins: int) -> Shadows:
    """Compute the strips that each pixel of (height, width) overlaps, and its share in each."""
    position, longer, shorter = _geometry(angle, height, width)
    longer, shorter = (value[:, None, None] * bins for value in (longer, shorter))
    margin = math.ceil((math.hypot(height, width) / width - 1) / 2 * bins) + 1
    rows = height // 2 if height % 2 == 0 else height
    left = torch.add(0.5 * bins - (longer + shorter) / 2, position[:, :rows], alpha=bins)
    edge = left.ceil()  # the first border between bins inside the footprint
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
    """Return the shares of a footprint in three bins as wide as a pixel, its left end `inside` [0, 1) before a border.

    As `_shadow`, without the branches that cannot occur: as longer² + shorter² is 1, the first border is less than
    `shorter` beyond the longer box, and the second, 1 later, as close to the right end.
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
    """Images (B, C, H, W) to bins (B, C, D), or, with `back`, its transpose: each is the gradient of the other."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, shadows: Shadows, back: bool) -> Tensor:
        ctx.shadows, ctx.back = shadows, back
        return (_cast_back if back else _cast)(values, shadows)

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor, None, None]:
        return _Cast.apply(gradient, ctx.shadows, not ctx.back), None, None


def _cast(image: Tensor, shadows: Shadows) -> Tensor:
    return torch.stack([_cast_channel(channel, shadows) for channel in image.unbind(1)], 1)


def _cast_back(bins: Tensor, shadows: Shadows) -> Tensor:
    return torch.stack([_cast_channel_back(channel, shadows) for channel in bins.unbind(1)], 1)


def _cast_channel(image: Tensor, shadows: Shadows) -> Tensor:
    """Project (B, H, W) to (B, D)."""
    if not shadows.halved:
        return _scatter(image, shadows)
    upper, lower = image.chunk(2, 1)
    return _scatter(upper, shadows) + _scatter(lower.flip(1, 2), shadows).flip(1)


def _cast_channel_back(bins: Tensor, shadows: Shadows) -> Tensor:
    """Project (B, D) back to (B, H, W)."""
    if not shadows.halved:
        return _gather(bins, shadows)
    return torch.cat([_gather(bins, shadows), _gather(bins.flip(1), shadows).flip(1, 2)], 1)


def _scatter(pixels: Tensor, shadows: Shadows) -> Tensor:
    pixels = pixels.flatten(1)
    total = pixels.new_zeros(len(pixels) * shadows.stride + len(shadows.shares))
    for m, share in enumerate(shadows.shares):
        # Flattened: scattering along the last of several dimensions is several times slower.
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
    """Return positions (B, H, W) of pixel centres along the detectors, and the widths (B,) of the footprint's boxes."""
    c, s = cos_sin(angle)
    x = ((torch.arange(width, dtype=angle.dtype, device=angle.device) * 2 + 1 - width) / (2 * width))[None, None]
    y = ((height - 1 - torch.arange(height, dtype=angle.dtype, device=angle.device) * 2) / (2 * width))[None, :, None]
    longer, shorter = torch.maximum(c.abs(), s.abs()) / width, torch.minimum(c.abs(), s.abs()) / width
    return x * c[:, None, None] + y * s[:, None, None], longer, shorter


def _shadow(t: Tensor, longer: Tensor, shorter: Tensor) -> Tensor:
    """Return the share of a footprint, box(longer) * box(shorter), that lies within t of its left end."""
    return (_ramp(t, shorter) - _ramp(t - longer, shorter)) / longer


def _ramp(t: Tensor, width: Tensor) -> Tensor:
    """Compute ∫ clamp(s / width, 0, 1) ds up to t; max(t, 0) for a width of 0."""
    reached = torch.minimum(t.clamp(min=0), width)
    # reached ≤ width, so the quotient is at most width / 2 and the clamp has no effect on the value.
    return t.clamp(min=0) - reached + reached.square() / (2 * width.clamp(min=1e-30))
