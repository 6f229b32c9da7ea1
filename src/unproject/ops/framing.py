"""Framing: silhouettes cropped to their object, so that its size and place do not matter.

1. Box. The profile of an axis is the largest value of each row (column). The box runs from the first to the last place
   where the profile crosses ½ of its maximum, linearly between pixels: of a binary picture, its bounding box. With thin
   parts, which cover less than half of any pixel, it runs from where the profile crosses ½ of the largest of the
   first three values that are at least 0.1 of its maximum.
2. Crop. The box is scaled until it is `height` of the frame high, or `width` of it wide, whichever comes first, and
   centred; aspect is kept. With one number for both it is the rule by which `data.frame` crops pictures of a folder.
3. Resampling. Each pixel of the result is the share of its area that is covered; outside the picture is 0.

The box is a constant for gradients, unless these are asked for: its edges depend on a few pixels only, which would have
the gradient of the whole picture.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from .resampling import centres, sample_volume

STEEP = 0.25
"""The least step between two pixels of a profile whose crossing is placed between them."""
FAINT, EDGE = 0.1, 3
"""The share of a pixel (of the largest of a profile) from which on something is there, and pixels of a soft edge."""


class Box(NamedTuple):
    """Edges of the object in pixels from the picture's first row and column, (B,) each."""

    top: Tensor
    bottom: Tensor
    left: Tensor
    right: Tensor

    @property
    def height(self) -> Tensor:
        """At least one pixel, (B,)."""
        return (self.bottom - self.top).clamp_min(1)

    @property
    def width(self) -> Tensor:
        """At least one pixel, (B,)."""
        return (self.right - self.left).clamp_min(1)

    @property
    def longer(self) -> Tensor:
        """The longer side, (B,)."""
        return torch.maximum(self.height, self.width)

    @property
    def centre(self) -> tuple[Tensor, Tensor]:
        """(row, column) of the centre, (B,) each."""
        return (self.top + self.bottom) / 2, (self.left + self.right) / 2


def bounding_box(silhouettes: Tensor, differentiable: bool = False, thin: bool = False) -> Box:
    """Return the boxes of silhouettes (B, 1, H, W); of an empty one the whole picture; without gradient, or with it.

    Args:
        differentiable: with gradient.
        thin: with thin parts, such as legs of a table that cover a third of each pixel. Not for what has haze.

    Examples:
        >>> import torch, unproject as up
        >>> mask = torch.zeros(1, 1, 8, 8)
        >>> mask[..., 2:4, 1:7] = 1
        >>> [edge.item() for edge in up.ops.bounding_box(mask)]
        [2.0, 4.0, 1.0, 7.0]
    """
    if not differentiable:
        silhouettes = silhouettes.detach()
    rows, columns = silhouettes[:, 0].amax(2), silhouettes[:, 0].amax(1)
    return Box(*_extent(rows, thin), *_extent(columns, thin))


def _extent(profile: Tensor, thin: bool) -> tuple[Tensor, Tensor]:
    """Return where profiles (B, N) first and last cross half of their maximum, in pixels from the start."""
    return _first(profile, thin), profile.shape[1] - _first(profile.flip(1), thin)


def _first(profile: Tensor, thin: bool) -> Tensor:
    level, steep = profile.amax(1, keepdim=True) / 2, profile.new_tensor(STEEP)
    if thin:
        highest = _first_height(profile)
        level, steep = torch.maximum(highest / 2, 2 * FAINT * level), STEEP * highest
    at = (profile >= level).to(torch.uint8).argmax(1, keepdim=True)
    here = profile.gather(1, at)
    before = torch.where(at > 0, profile.gather(1, (at - 1).clamp_min(0)), torch.zeros_like(here))
    # The centres of this pixel and of the one before lie half a pixel from their common edge: a full pixel beside an
    # empty one begins at the edge.
    crossing = at + 0.5 - (here - level) / torch.maximum(here - before, steep)
    return torch.where(level > 0, crossing, torch.zeros_like(crossing))[:, 0]


def _first_height(profile: Tensor) -> Tensor:
    """Return the largest of the first values of profiles (B, N) that are not faint, (B, 1)."""
    first = (profile >= FAINT * profile.amax(1, keepdim=True)).to(torch.uint8).argmax(1, keepdim=True)
    at = (first + torch.arange(EDGE, device=profile.device)).clamp_max(profile.shape[1] - 1)
    return profile.gather(1, at).amax(1, keepdim=True)


def framed(
    silhouettes: Tensor, size: int, height: float = 0.85, width: float | None = None, thin: bool = False
) -> Tensor:
    """Return silhouettes (B, 1, H, W) cropped, scaled and centred, (B, 1, size, size); differentiable.

    Args:
        size: pixels a side of the result.
        height, width: of the object at most, as shares of the frame (default of the width: the height).
        thin: thin parts belong to the object, as in `bounding_box`.

    Examples:
        >>> import torch, unproject as up
        >>> small, large = torch.zeros(2, 1, 1, 32, 32)
        >>> small[..., 3:9, 20:26], large[..., 4:28, 2:26] = 1, 1
        >>> a, b = (up.ops.framed(mask, 16, height=0.75) for mask in (small, large))
        >>> bool(torch.allclose(a, b, atol=1e-5)), a.mean().item()
        (True, 0.5625)
    """
    box = bounding_box(silhouettes, thin=thin)
    pixel = torch.maximum(box.height / height, box.width / (width or height)) / size
    return resampled(silhouettes, box.centre, pixel, size)


def resampled(silhouettes: Tensor, centre: tuple[Tensor, Tensor], pixel: Tensor, size: int) -> Tensor:
    """Return (B, 1, size, size) of area averages around `centre` (row, column), `pixel` (B,) pixels wide."""
    down, across = (
        _shares(middle, pixel, count, size) for middle, count in zip(centre, silhouettes.shape[2:], strict=True)
    )
    return (down @ silhouettes[:, 0].to(down) @ across.transpose(1, 2)).clamp(0, 1)[:, None]


def _shares(middle: Tensor, cell: Tensor, count: int, size: int) -> Tensor:
    """Return (B, size, count): the share of output pixel i, `cell` (B,) pixels wide, that input pixel j covers."""
    edges = torch.arange(size + 1, device=middle.device, dtype=middle.dtype) - size / 2
    edges = middle[:, None] + edges * cell[:, None]
    pixels = torch.arange(count, device=middle.device, dtype=middle.dtype)
    shared = torch.minimum(edges[:, 1:, None], pixels + 1) - torch.maximum(edges[:, :-1, None], pixels)
    return shared.clamp_min(0) / cell[:, None, None]


def common_fill(silhouettes: Tensor, tolerance: float = 0.05, share: float = 0.95) -> float | None:
    """Return the `fill` that silhouettes (N, 1, H, W) were cropped with; None if they were not cropped one by one.

    They were if at least `share` of them are centred, and equally long on their longer side, within `tolerance` times
    the frame.

    Examples:
        >>> import torch, unproject as up
        >>> masks = (torch.rand(8, 1, 32, 32, generator=torch.Generator().manual_seed(0)) > 0.5).float()
        >>> masks[..., :8] = 0
        >>> up.ops.common_fill(masks) is None, up.ops.common_fill(up.ops.framed(masks, 32, 0.75))
        (True, 0.75)
    """
    box, (height, width) = bounding_box(silhouettes, thin=True), silhouettes.shape[2:]
    row, column = box.centre
    longer = box.longer.median()
    off = torch.stack([(row - height / 2).abs(), (column - width / 2).abs(), (box.longer - longer).abs()])
    cropped = height == width and bool((off <= tolerance * height).all(0).double().mean() >= share)
    return round(float(longer) / height, 3) if cropped else None


LEAST_HEIGHT, WIDEST = 0.2, 0.9
"""The least height that silhouettes are framed to, and how wide most of them are then at most, shares of the frame."""


def common_height(silhouettes: Tensor, share: float = 0.9) -> float:
    """Return the height, as a share of the frame, at which a `share` of silhouettes is at most 0.9 of it wide.

    It is at most 0.85 and at least 0.2.

    Examples:
        >>> import torch, unproject as up
        >>> masks = torch.zeros(4, 1, 32, 32)
        >>> masks[..., 12:20, 4:28] = 1  # three times as wide as high
        >>> up.ops.common_height(masks)
        0.3
    """
    return round(min(max(WIDEST / aspect(silhouettes, share), LEAST_HEIGHT), 0.85), 3)


NARROW = 0.02
"""The share of silhouettes that count as the narrowest: as many may be slivers that nobody meant."""


def aspect(silhouettes: Tensor, share: float) -> float:
    """Return how many times as wide as high a `share` of silhouettes (N, 1, H, W) is at most, by their boxes.

    Examples:
        >>> import torch, unproject as up
        >>> masks = torch.zeros(4, 1, 32, 32)
        >>> masks[..., 12:20, 4:28] = 1  # three times as wide as high
        >>> masks[:2, ..., 12:] = 0  # the same width and height
        >>> up.ops.aspect(masks, 0.25), up.ops.aspect(masks, 1.0)
        (1.0, 3.0)
    """
    box = bounding_box(silhouettes, thin=True)
    return torch.quantile(box.width / box.height, share).item()


def unit_sized(x: Tensor, side: float = 0.8) -> Tensor:
    """Return volumes (B, X, Y, Z) moved and scaled so that the longest side of their box at 0.5 is `side` of the frame.

    The box is centred; interpolation is trilinear. A volume with nothing above 0.5 stays as it is.

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.zeros(1, 16, 16, 16)
        >>> x[:, 1:5, 1:9, 1:5] = 1
        >>> [int(n) for n in (up.ops.unit_sized(x, side=0.75)[0] > 0.5).nonzero().amin(0)]
        [5, 2, 5]
    """
    return torch.stack([_unit_sized(volume, side) if bool((volume > 0.5).any()) else volume for volume in x])


def _unit_sized(volume: Tensor, side: float) -> Tensor:
    occupied = (volume > 0.5).nonzero()
    low, high = occupied.amin(0), occupied.amax(0) + 1
    scale = (high - low).max() / (side * max(volume.shape))
    places = [(centres(n, volume) * n * scale + low[i] + high[i]) / n - 1 for i, n in enumerate(volume.shape)]
    points = torch.stack(torch.meshgrid(*places, indexing="ij"), -1)
    return sample_volume(volume[None], points[None])[0]
