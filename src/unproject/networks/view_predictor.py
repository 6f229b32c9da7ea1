"""View predictor: which way of looking made this image?"""

from __future__ import annotations

from torch import Tensor, nn

BLOCKS = 4


class ViewPredictor(nn.Module):
    """The discriminator's four stride-2 convolutions with batch norm, and logits over the bins.

    References:
        Li et al. 2019, supplemental, Part I.
    """

    def __init__(self, shape: tuple[int, ...], bins: int, channels: int = 16) -> None:
        super().__init__()
        widths = [shape[0], *[channels * 2**i for i in range(BLOCKS)]]
        layers: list[nn.Module] = []
        for before, after in zip(widths, widths[1:], strict=False):
            layers += [nn.Conv2d(before, after, 4, 2, 1), nn.BatchNorm2d(after), nn.LeakyReLU(0.1)]
        features = widths[-1] * (shape[1] // 2**BLOCKS) * (shape[2] // 2**BLOCKS)
        self.layers = nn.Sequential(*layers, nn.Flatten(), nn.Linear(features, bins))

    def forward(self, image: Tensor) -> Tensor:
        """Logits (B, bins) of images (B, C, H, W) in [0, 1]."""
        return self.layers(image * 2 - 1)
