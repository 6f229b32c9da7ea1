"""Line integrals on a GPU, in Triton: the sums of `line_integrals.strip_integrals`, whose areas are not stored.

A program sums over all pixels for some detectors, or over all detectors for some pixels, so that nothing is added to by
several programs at a time and equal inputs give equal bits.
"""

# pyright: reportMissingImports=false, reportIndexIssue=false, reportArgumentType=false, reportCallIssue=false
# pyright: reportAttributeAccessIssue=false, reportOptionalMemberAccess=false, reportGeneralTypeIssues=false

from __future__ import annotations

import torch
import triton
import triton.language as tl
from torch import Tensor

BINS, PIXELS = 16, 64
"""Detectors and pixels of a block."""


@triton.jit
def _ramp(t, width):
    """∫ clamp(s / width, 0, 1) ds up to t."""
    above = tl.maximum(t, 0.0)
    reached = tl.minimum(above, width)
    return above - reached + reached * reached / (2 * tl.maximum(width, 1e-30))


@triton.jit
def _shadow(t, longer, shorter):
    """The share of a footprint that lies within t of its left end."""
    return (_ramp(t, shorter) - _ramp(t - longer, shorter)) / longer


@triton.jit
def _shares(c, s, pixel, detector, H, W, D):
    """The share of each pixel (P,) in each detector (N,), (N, P); lengths are in detectors."""
    x = ((pixel % W) * 2 + 1 - W).to(c.dtype) / (2 * W) * D
    y = (H - 1 - (pixel // W) * 2).to(c.dtype) / (2 * W) * D
    longer, shorter = tl.maximum(tl.abs(c), tl.abs(s)) / W * D, tl.minimum(tl.abs(c), tl.abs(s)) / W * D
    position = x * c + y * s - (longer + shorter) / 2 + D * 0.5
    from_left = detector.to(c.dtype)[:, None] - position[None, :]
    return _shadow(from_left + 1, longer, shorter) - _shadow(from_left, longer, shorter)


@triton.jit
def _project(image, turned, out, batch, channels, H, W, D, BINS: tl.constexpr, PIXELS: tl.constexpr):
    """Images (B, C, H, W) to detectors (B, C, D)."""
    item, detector = tl.program_id(0), tl.program_id(1) * BINS + tl.arange(0, BINS)
    c, s = tl.load(turned + item // channels), tl.load(turned + batch + item // channels)
    total = tl.zeros([BINS], c.dtype)
    for first in range(0, H * W, PIXELS):
        pixel = first + tl.arange(0, PIXELS)
        values = tl.load(image + item.to(tl.int64) * H * W + pixel, pixel < H * W, 0)
        total += tl.sum(_shares(c, s, pixel, detector, H, W, D) * values[None, :], 1)
    total = tl.where(tl.abs(c) <= 1, total * D / (W * W), float("nan"))
    tl.store(out + item * D + detector, total, detector < D)


@triton.jit
def _project_back(bins, turned, out, batch, channels, H, W, D, BINS: tl.constexpr, PIXELS: tl.constexpr):
    """Detectors (B, C, D) to images (B, C, H, W): the transpose of `_project`."""
    item, pixel = tl.program_id(0), tl.program_id(1) * PIXELS + tl.arange(0, PIXELS)
    c, s = tl.load(turned + item // channels), tl.load(turned + batch + item // channels)
    total = tl.zeros([PIXELS], c.dtype)
    for first in range(0, D, BINS):
        detector = first + tl.arange(0, BINS)
        values = tl.load(bins + item * D + detector, detector < D, 0)
        total += tl.sum(_shares(c, s, pixel, detector, H, W, D) * values[:, None], 0)
    total = tl.where(tl.abs(c) <= 1, total * D / (W * W), float("nan"))
    tl.store(out + item.to(tl.int64) * H * W + pixel, total, pixel < H * W)


def project(values: Tensor, turned: Tensor, size: tuple[int, int], bins: int, back: bool) -> Tensor:
    """Return detectors (B, C, bins) of contiguous images (B, C, *size), or, with `back`, the transpose of detectors.

    Args:
        turned: (2, B), cos and sin of the angles.
    """
    (batch, channels), (height, width) = values.shape[:2], size
    result = values.new_empty(batch, channels, *(size if back else (bins,)))
    blocks = triton.cdiv(height * width, PIXELS) if back else triton.cdiv(bins, BINS)
    if result.numel():
        with torch.cuda.device_of(values):
            (_project_back if back else _project)[batch * channels, blocks](
                values, turned.contiguous(), result, batch, channels, height, width, bins, BINS=BINS, PIXELS=PIXELS
            )
    return result
