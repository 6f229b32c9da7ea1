"""A discriminator of textures: what is in a picture counts, not where, and its company in the batch."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .._types import UserError
from .blocks import upsampling_levels

FLOOR = 1e-4  # of a variance, so that its root has a slope


class TextureDiscriminator(nn.Module):
    """Statistics of a window's features: means and deviations over places, level by level, and over the batch.

    Stride-2 convolutions of a window down to 4², channels doubling. Of every level's features f the means over places
    and the deviations around them, s; of s the deviations over the batch, d. Logit: a row a head times
    LeakyReLU(A s + B d). A few hundred pictures are thousands of windows, and their average has no place to be learned
    by heart; d finds out a generator that makes one thing again and again.

    The windows of successive calls in training lie low-discrepant (Roberts' R₂), counted in a buffer, so that a resumed
    run goes on with the next; outside of training the window is the middle.

    Args:
        shape: (C, H, W) of one image, square, a side of 4·2^k.
        heads: rows of the last layer, one a way of looking.
        channels: after the first convolution.
        group: images compared with one another: real and generated ones of a concatenated pass are not to be mixed.
        window: side of the window, 8 at least; half the side of the image unless given.

    References:
        Gatys et al. 2015 (statistics of features as textures); Karras et al. 2018 (deviations over the batch);
        Roberts 2018, The unreasonable effectiveness of quasirandom sequences (R₂).

    Raises:
        UserError: for images of another shape, or a window that is no 4·2^k or larger than they.
    """

    taken: Tensor

    def __init__(
        self,
        shape: tuple[int, ...],
        heads: int = 1,
        channels: int = 24,
        group: int | None = None,
        window: int | None = None,
        hidden: int = 128,
        slope: float = 0.2,
    ) -> None:
        super().__init__()
        if len(shape) != 3 or shape[1] != shape[2]:
            raise UserError(f"texture discriminator: give square images (C, H, H), not {shape}")
        self.window, self.group, self.slope = window or max(shape[1] // 2, 8), group, slope
        if self.window > shape[1]:
            raise UserError(f"texture discriminator: a window of {self.window} does not fit into {shape[1]} pixels")
        widths = [shape[0], *[channels * 2**k for k in range(upsampling_levels(self.window))]]
        self.convolutions = nn.ModuleList([nn.Conv2d(a, b, 4, 2, 1) for a, b in zip(widths, widths[1:], strict=False)])
        features = 2 * sum(widths[1:])
        self.own, self.between = nn.Linear(features, hidden), nn.Linear(features, hidden)
        self.last = nn.Embedding(heads, hidden + 1)
        nn.init.normal_(self.last.weight, std=hidden**-0.5)
        self.register_buffer("taken", torch.zeros((), dtype=torch.long))

    def forward(self, image: Tensor, head: Tensor) -> Tensor:
        """Logits (B,) of images in [0, 1], which are scaled to [-1, 1]; `head` (B,) chooses the head of each."""
        row, column = self._place(image.shape[-1] - self.window)
        x = image[:, :, row : row + self.window, column : column + self.window] * 2 - 1
        s = self._statistics(x.contiguous(memory_format=torch.channels_last))
        d = torch.cat([_deviation(part, 0).expand_as(part) for part in s.split(self.group or len(s))])
        y = F.leaky_relu(self.own(s) + self.between(d), self.slope)
        weights = self.last(head)
        return (y * weights[:, :-1]).sum(1) + weights[:, -1]

    def _statistics(self, x: Tensor) -> Tensor:
        found = []
        for convolution in self.convolutions:
            x = F.leaky_relu(convolution(x), self.slope)
            found += [x.mean((2, 3)), _deviation(x, (2, 3)).flatten(1)]
        return torch.cat(found, 1)

    def _place(self, room: int) -> tuple[int, int]:
        """Row and column of the window."""
        if not self.training:
            return room // 2, room // 2
        self.taken += 1
        return tuple(int(math.fmod(0.5 + a * self.taken.item(), 1) * (room + 1)) for a in R2)  # pyright: ignore


def _deviation(x: Tensor, over: int | tuple[int, ...]) -> Tensor:
    return ((x - x.mean(over, keepdim=True)).square().mean(over, keepdim=True) + FLOOR).sqrt()


PLASTIC = 1.32471795724474602596  # x³ = x + 1
R2 = (1 / PLASTIC, 1 / PLASTIC**2)
