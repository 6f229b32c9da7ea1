"""Outlines of silhouettes: whether cameras were level, and whether pictures are their own mirror images."""

from __future__ import annotations

import torch
from torch import Tensor

BREAK = 2.0
"""Pixels from one column to the next that an outline rises at most: more is another part of the object."""
LEVEL = 0.5
"""The share of level outlines beyond which cameras count as level: it is 0.55 or more of furniture seen at elevation 0,
0.47 or less at 8 +- 5 degrees."""


def level_share(silhouettes: Tensor) -> float:
    """Return the share of an outline's straight, not steep pieces that are level; 0 for silhouettes without any.

    The upper (lower) outline of a silhouette is the height of the first (last) covered place of each column. A piece
    as wide as a quarter of the picture, w, without a break, that rises by d is level if d < w / 16 (3.6 degrees), and
    not steep if d <= w / 2.

    A level orthographic camera shows every horizontal edge and plane as a level line, from any azimuth. One at
    elevation e shows an edge that runs at azimuth a from the picture's plane at a slope of sin(e) tan(a), and so does
    perspective. Rendered chairs, beds and night stands, 32 or 64 pixels a side: 0.55 to 0.91 at elevation 0, 0.24 to
    0.47 at 8 +- 5 degrees, 0.11 to 0.29 at 25 +- 8; birds 0.02 to 0.11 at any: nothing can be told of them.

    Args:
        silhouettes: (N, 1, H, W), values from 0 to 1; a column is covered from where it exceeds 0.5.

    Examples:
        >>> import torch, unproject as up
        >>> box = torch.zeros(1, 1, 32, 32)
        >>> box[..., 8:20, 4:28] = 1
        >>> row, column = torch.meshgrid(torch.arange(32), torch.arange(32), indexing="ij")
        >>> roof = (3 * row > column).float()[None, None]
        >>> up.ops.level_share(box), up.ops.level_share(roof)
        (1.0, 0.5)
    """
    window = max(4, silhouettes.shape[-1] // 4)
    if silhouettes.shape[-1] < window:
        return 0.0
    level = slanted = 0
    for picture in (silhouettes[:, 0], silhouettes[:, 0].flip(1)):
        height, covered = upper_outline(picture)
        rise = height.diff(dim=1).abs()
        whole = ((rise <= BREAK) & covered[:, 1:] & covered[:, :-1]).unfold(1, window - 1, 1).all(-1)
        rise = (height[:, window - 1 :] - height[:, : 1 - window]).abs()[whole]
        level += int((rise < window / 16).sum())
        slanted += int(((rise >= window / 16) & (rise <= window / 2)).sum())
    return level / max(level + slanted, 1)


def mirror_iou(silhouettes: Tensor) -> Tensor:
    """Return the IoU at 0.5 of each silhouette (N, 1, H, W) with its mirror image about the middle of its box, (N,).

    Of an empty one it is 0. Bodies of revolution are their own mirror images from any side, boxes only from level.

    Examples:
        >>> import torch, unproject as up
        >>> wedge = torch.ones(8, 8).tril()[None, None]
        >>> up.ops.mirror_iou(torch.cat([wedge, torch.ones(1, 1, 8, 8)]))
        tensor([0.3846, 1.0000])
    """
    inside = silhouettes[:, 0] > 0.5
    width, columns = inside.shape[2], inside.any(1).int()
    ends = columns.argmax(1) + width - 1 - columns.flip(1).argmax(1)
    mirrored = ends[:, None] - torch.arange(width, device=inside.device)
    within = ((mirrored >= 0) & (mirrored < width))[:, None]
    other = inside.gather(2, mirrored.clamp(0, width - 1)[:, None].expand_as(inside)) & within
    return (inside & other).flatten(1).sum(1) / (inside | other).flatten(1).sum(1).clamp_min(1)


def upper_outline(picture: Tensor) -> tuple[Tensor, Tensor]:
    """Return the place of the upper edge of each column, in pixels from the top, and whether there is one; (N, W)."""
    covered = picture > 0.5
    first = covered.int().argmax(1, keepdim=True)
    above = torch.where(first > 0, picture.gather(1, (first - 1).clamp_min(0)), torch.zeros_like(picture[:, :1]))
    return (first + 1 - picture.gather(1, first) - above)[:, 0], covered.any(1)
