"""View predictor: which way of looking made this image?"""

from __future__ import annotations

import math

from torch import Tensor, nn

BLOCKS = 4


class ViewPredictor(nn.Module):
    """The discriminator's four stride-2 convolutions with batch norm, and logits over the bins.

    Args:
        shape: of one input: (C, H, W), or (C, W) for lines.

    References:
        Li et al. 2019, supplemental, Part I.
    """

    def __init__(self, shape: tuple[int, ...], bins: int, channels: int = 16) -> None:
        super().__init__()
        widths = [shape[0], *[channels * 2**i for i in range(BLOCKS)]]
        lines = len(shape) == 2
        convolution, norm = (nn.Conv1d, nn.BatchNorm1d) if lines else (nn.Conv2d, nn.BatchNorm2d)
        layers: list[nn.Module] = []
        for before, after in zip(widths, widths[1:], strict=False):
            layers += [convolution(before, after, 4, 2, 1), norm(after), nn.LeakyReLU(0.1)]
        features = widths[-1] * math.prod(side // 2**BLOCKS for side in shape[1:])
        self.layers = nn.Sequential(*layers, nn.Flatten(), nn.Linear(features, bins))

    def forward(self, image: Tensor) -> Tensor:
        """Logits (B, bins) of images (B, C, H, W), or lines (B, C, W), in [0, 1]."""
        return self.layers(image * 2 - 1)
