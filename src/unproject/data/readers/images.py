"""Pictures as they are: neither thresholded nor cropped, uint8 where they came so."""

from __future__ import annotations

from collections.abc import Callable

import torch
import torch.nn.functional as F
from torch import Tensor

from .found import chunks, to_bytes, to_floats
from .framing import cells

LUMA = (0.299, 0.587, 0.114)
"""Weights of red, green and blue in a grey picture: ITU-R BT.601, as Pillow's."""


def as_images(pictures: Tensor, size: int | None = None, colour: bool = False) -> Tensor:
    """Pictures (N, C, H, W), C of 1 to 4 (2 and 4: the last is alpha), as (N, 1 or 3, size, size) of the same type.

    Colours are multiplied by alpha, so that what is transparent is black.
    """
    wanted = 3 if colour else 1
    if pictures.shape[1] != wanted:
        pictures = torch.cat([_computed(part, lambda x: _channels(x, wanted)) for part in chunks(pictures)])
    return pictures if size is None else fitted(pictures, size)


def fitted(pictures: Tensor, size: int) -> Tensor:
    """Pictures (N, C, H, W) at (N, C, size, size): larger ones averaged down, smaller ones in a margin of 0.

    Those that fit in two times or more are enlarged by the largest whole number first.
    """
    side = max(pictures.shape[2:])
    if side > size:
        pictures = torch.cat([_computed(part, lambda x: _averaged(x, size)) for part in chunks(pictures)])
    elif (times := size // side) > 1:
        pictures = torch.cat([_computed(part, lambda x: _enlarged(x, times)) for part in chunks(pictures)])
    height, width = (size - side for side in pictures.shape[2:])
    return F.pad(pictures, (width // 2, width - width // 2, height // 2, height - height // 2))


def _computed(pictures: Tensor, function: Callable[[Tensor], Tensor]) -> Tensor:
    """A function of values in [0, 1], rounded to 8 bits for pictures of 8 bits."""
    if pictures.dtype != torch.uint8:
        return function(pictures)
    return to_bytes(function(to_floats(pictures, 255)))


def _channels(x: Tensor, wanted: int) -> Tensor:
    colours = x.shape[1] - (x.shape[1] in (2, 4))
    alpha = x[:, colours:] if colours < x.shape[1] else 1.0
    x = x[:, :colours] * alpha
    if wanted == 1 and colours == 3:
        return (x * x.new_tensor(LUMA)[:, None, None]).sum(1, keepdim=True)
    return x.expand(-1, wanted, -1, -1)


def _enlarged(x: Tensor, times: int) -> Tensor:
    return F.interpolate(x, scale_factor=times, mode="bilinear", align_corners=False)


def _range(x: Tensor) -> tuple[float, float]:
    """From where to where averages may run: [0, 1], and as far as pictures that are not within it do."""
    return min(x.min().item(), 0.0), max(x.max().item(), 1.0)


def _averaged(x: Tensor, size: int) -> Tensor:
    """Area averages over the square around the whole picture, which has black beyond it."""
    side = max(x.shape[2:])
    down, across = (cells(length, (length - side) / 2, (length + side) / 2, size).to(x) for length in x.shape[2:])
    return torch.einsum("ih,nchw,jw->ncij", down, x, across).clamp(*_range(x))
