"""TextureDiscriminator: scores statistics of features over places and over the batch."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from .._types import UserError
from ..ops.low_discrepancy import STEPS
from .blocks import check_widths, upsampling_levels

FLOOR = 1e-4  # added to variances: the derivative of their root stays finite


class TextureDiscriminator(nn.Module):
    """A discriminator of textures: statistics of features in windows of an image pyramid.

    The image is averaged down by 1, 2, 4, … until it fits into a window. Each scale has stride-2 convolutions of one
    window, down to 4², with doubling channels. s are the means and deviations over places of the features of every
    layer, d the deviations of s over the batch. The logit is the head's row of weights times LeakyReLU(A s + B d).

    Windows multiply the number of training images, and statistics over places prevent memorising them; d detects a
    generator that repeats itself. In training, windows of successive calls follow Roberts' R₂ sequence, counted in a
    buffer, so that a resumed run continues the sequence; in evaluation mode they are central.

    Args:
        shape: (C, H, W) of one image, square, with a side of 4·2^k.
        heads: number of heads, the rows of the last layer; one for each observation.
        channels: after the first convolution of each scale.
        group: size of the groups of consecutive images over which d is computed (default: the whole batch, in training
            as many as the recipe's batch, so that real and generated images of a concatenated one are not mixed).
        window: side of the windows, 8 or more (default: 32, or the side of smaller images).
        hidden: rows of A and B.
        slope: of LeakyReLU.

    References:
        Gatys et al. 2015 (statistics of features as textures); Wang et al. 2018, pix2pixHD (discriminators of several
        scales); Karras et al. 2018 (deviations over the batch); Roberts 2018 (R₂).

    Raises:
        UserError: for images of another shape, or a window that is not 4·2^k or is larger than the images.

    Examples:
        >>> import torch, unproject as up
        >>> discriminator = up.networks.TextureDiscriminator((3, 32, 32), heads=2, channels=4)
        >>> discriminator(torch.rand(4, 3, 32, 32), head=torch.tensor([0, 1, 0, 1])).shape
        torch.Size([4])
    """

    taken: Tensor

    replayable = True

    def __init__(
        self,
        shape: tuple[int, ...],
        heads: int = 1,
        channels: int = 16,
        group: int | None = None,
        window: int | None = None,
        hidden: int = 128,
        slope: float = 0.2,
    ) -> None:
        check_widths("texture discriminator", channels=channels)
        super().__init__()
        if len(shape) != 3 or shape[1] != shape[2]:
            raise UserError(f"texture discriminator: give square images (C, H, H), not {shape}")
        self.window, self.group, self.slope = window or min(shape[1], 32), group, slope
        if self.window > shape[1]:
            raise UserError(f"texture discriminator: a window of {self.window} does not fit into {shape[1]} pixels")
        widths = [shape[0], *[channels * 2**k for k in range(upsampling_levels(self.window))]]
        scales = upsampling_levels(shape[1]) - len(widths) + 2
        self.scales = nn.ModuleList([_stack(widths) for _ in range(scales)])
        features = 2 * sum(widths[1:]) * scales
        self.own, self.between = nn.Linear(features, hidden), nn.Linear(features, hidden)
        self.last = nn.Embedding(heads, hidden + 1)
        nn.init.normal_(self.last.weight, std=hidden**-0.5)
        self.register_buffer("taken", torch.zeros((), dtype=torch.long))

    def forward(self, image: Tensor, head: Tensor) -> Tensor:
        """Return logits (B,) of images in [0, 1], which are scaled to [-1, 1]; `head` (B,) is the head of each."""
        image = (image * 2 - 1).contiguous(memory_format=torch.channels_last)
        s = torch.cat([self._statistics(k, x) for k, x in enumerate(self.windows(image))], 1)
        d = torch.cat([_deviation(part, 0).expand_as(part) for part in s.split(self.group or len(s))])
        y = F.leaky_relu(self.own(s) + self.between(d), self.slope)
        weights = self.last(head)
        return (y * weights[:, :-1]).sum(1) + weights[:, -1]

    def windows(self, image: Tensor) -> list[Tensor]:
        """Return one window of each scale, finest first; the last is the whole image."""
        self.taken += int(self.training)
        scales = [F.avg_pool2d(image, 2**k) if k else image for k in range(len(self.scales))]
        return [self._window(x) for x in scales]

    def _window(self, x: Tensor) -> Tensor:
        places, side = x.shape[-1] - self.window + 1, self.window
        if x.is_cuda:  # where operations are replayed, so that they must not depend on the place
            steps = torch.stack([torch.full_like(self.taken, step, dtype=torch.float64) for step in STEPS])
            first = (torch.fmod(0.5 + steps * (self.taken if self.training else 0), 1) * places).long()
            rows, columns = first[:, None] + torch.arange(side, device=x.device)
            return x.index_select(2, rows).index_select(3, columns)
        taken = self.taken.item() if self.training else 0
        row, column = (int(math.fmod(0.5 + step * taken, 1) * places) for step in STEPS)
        return x[:, :, row : row + side, column : column + side]

    def _statistics(self, k: int, x: Tensor) -> Tensor:
        found = []
        for convolution in self.scales[k]:  # pyright: ignore[reportGeneralTypeIssues]
            x = F.leaky_relu(convolution(x), self.slope)
            found += [x.mean((2, 3)), _deviation(x, (2, 3)).flatten(1)]
        return torch.cat(found, 1)


def _stack(widths: list[int]) -> nn.ModuleList:
    return nn.ModuleList([nn.Conv2d(a, b, 4, 2, 1) for a, b in zip(widths, widths[1:], strict=False)])


def _deviation(x: Tensor, over: int | tuple[int, ...]) -> Tensor:
    return ((x - x.mean(over, keepdim=True)).square().mean(over, keepdim=True) + FLOOR).sqrt()
