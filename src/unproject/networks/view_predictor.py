"""ViewPredictor: a classifier of the observation that made an image."""

from __future__ import annotations

import math

import torch.nn.functional as F
from torch import Tensor, nn

from .._types import UserError

BLOCKS = 4


class ViewPredictor(nn.Module):
    """Four stride-2 convolutions as in `Discriminator`, with batch norm, and logits over the bins.

    Args:
        shape: of one input: (C, H, W), or (C, W) for lines.
        bins: number of classes, one for each observation.
        channels: after the first convolution; they double with each one.
        most: images of a shorter side of t times as many pixels are averaged over t² (default: none are). Predictors
            of images of several sizes then have the same weights.

    Raises:
        UserError: for images of fewer than 16 pixels a side, or of sides that t does not divide.

    References:
        Li et al. 2019, supplemental, Part I.

    Examples:
        >>> import torch, unproject as up
        >>> predictor = up.networks.ViewPredictor((1, 32, 32), bins=16)
        >>> predictor(torch.rand(4, 1, 32, 32)).shape
        torch.Size([4, 16])
    """

    def __init__(self, shape: tuple[int, ...], bins: int, channels: int = 16, most: int | None = None) -> None:
        super().__init__()
        self.times = max(min(shape[1:]) // most, 1) if most else 1
        if any(side % self.times for side in shape[1:]):
            raise UserError(f"images of {shape[1:]} cannot be averaged over {self.times} pixels; leave `most` out")
        shape = (shape[0], *(side // self.times for side in shape[1:]))
        if min(shape[1:]) < 2**BLOCKS:
            raise UserError(
                f"views are predicted from images of at least {2**BLOCKS} a side, and these have {min(shape[1:])}"
            )
        widths = [shape[0], *[channels * 2**i for i in range(BLOCKS)]]
        lines = len(shape) == 2
        convolution, norm = (nn.Conv1d, nn.BatchNorm1d) if lines else (nn.Conv2d, nn.BatchNorm2d)
        layers: list[nn.Module] = []
        for before, after in zip(widths, widths[1:], strict=False):
            layers += [convolution(before, after, 4, 2, 1), norm(after), nn.LeakyReLU(0.1)]
        features = widths[-1] * math.prod(side // 2**BLOCKS for side in shape[1:])
        self.layers = nn.Sequential(*layers, nn.Flatten(), nn.Linear(features, bins))

    def forward(self, image: Tensor) -> Tensor:
        """Return logits (B, bins) of images (B, C, H, W), or lines (B, C, W), in [0, 1]."""
        if self.times > 1:
            image = (F.avg_pool2d if image.dim() == 4 else F.avg_pool1d)(image, self.times)
        return self.layers(image * 2 - 1)
