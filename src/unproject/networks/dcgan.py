"""DCGANDiscriminator: batch norm and minibatch discrimination, as for the paper's materials."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from .._types import UserError
from .blocks import check_widths, upsampling_levels


class DCGANDiscriminator(nn.Module):
    """Stride-2 convolutions to 4², each with LeakyReLU and, after the first, batch norm; minibatch discrimination.

    Args:
        shape: (C, H, W) of one image, square, with a side of 4·2^k.
        heads: number of heads, the rows of the last layer; one for each observation.
        channels: after the first convolution; they double with each one, up to eight times as many.
        group: size of the groups of consecutive images that share batch statistics (default: the whole batch). The
            discriminator's update concatenates real and generated images, the generator's has generated ones only; in
            training a group is as many as the recipe's batch, so that both normalise generated images alike.
        kernels: number of minibatch discrimination features.
        slope: of LeakyReLU.

    References:
        Li et al. 2019, supplemental, section 2.2; Radford et al. 2016; Salimans et al. 2016 (minibatch discrimination).

    Raises:
        UserError: for images of another shape.

    Examples:
        >>> import torch, unproject as up
        >>> discriminator = up.networks.DCGANDiscriminator((3, 16, 16), heads=2, channels=8)
        >>> discriminator(torch.rand(4, 3, 16, 16), torch.tensor([0, 1, 0, 1])).shape
        torch.Size([4])
    """

    replayable = True

    def __init__(
        self,
        shape: tuple[int, ...],
        heads: int = 1,
        channels: int = 64,
        group: int | None = None,
        kernels: int = 16,
        slope: float = 0.2,
    ) -> None:
        check_widths("DCGAN discriminator", channels=channels)
        super().__init__()
        if len(shape) != 3 or shape[1] != shape[2]:
            raise UserError(f"DCGAN discriminator: give square images (C, H, H), not {shape}")
        widths = [min(channels * 2**k, 8 * channels) for k in range(upsampling_levels(shape[1]))]
        layers: list[nn.Module] = [nn.Conv2d(shape[0], widths[0], 4, 2, 1), nn.LeakyReLU(slope)]
        for before, after in zip(widths, widths[1:], strict=False):
            layers += [nn.Conv2d(before, after, 4, 2, 1), nn.BatchNorm2d(after), nn.LeakyReLU(slope)]
        self.layers = nn.Sequential(*layers)
        features = widths[-1] * 4**2
        self.group = group
        self.minibatch = MinibatchDiscrimination(features, kernels)
        self.last = nn.Embedding(heads, features + kernels + 1)
        nn.init.normal_(self.last.weight, std=features**-0.5)

    def forward(self, image: Tensor, head: Tensor) -> Tensor:
        """Return logits (B,) of images in [0, 1], which are scaled to [-1, 1]; `head` (B,) is the head of each."""
        x = torch.cat([self._features(part) for part in image.split(self.group or len(image))])
        row = self.last(head)
        return (x * row[:, :-1]).sum(1) + row[:, -1]

    def _features(self, image: Tensor) -> Tensor:
        x = self.layers((image * 2 - 1).contiguous(memory_format=torch.channels_last)).flatten(1)
        return torch.cat([x, self.minibatch(x)], 1)


class MinibatchDiscrimination(nn.Module):
    """The similarity of a sample to its batch: o_k(i) = Σ_{j ≠ i} exp(-|M_k f_i - M_k f_j|₁), K matrices M_k.

    With these features a discriminator detects a generator that repeats itself.

    References:
        Salimans et al. 2016, Improved techniques for training GANs, section 3.2.
    """

    def __init__(self, features: int, kernels: int = 16, rows: int = 5) -> None:
        super().__init__()
        self.shape = (kernels, rows)
        self.matrix = nn.Linear(features, kernels * rows, bias=False)
        nn.init.normal_(self.matrix.weight, std=1 / math.sqrt(features))

    def forward(self, features: Tensor) -> Tensor:
        """Return (B, kernels) of features (B, F)."""
        m = self.matrix(features).view(len(features), *self.shape)
        distance = (m[:, None] - m[None]).abs().sum(-1)
        return torch.exp(-distance).sum(1) - 1  # without j = i
