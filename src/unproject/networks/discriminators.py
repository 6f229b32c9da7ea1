"""Discriminator: tells real y from P_i(G(z), θ), with one head for every way of looking."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.nn.utils.parametrize import register_parametrization

from .._types import UserError
from .blocks import HeadConv, grouped_linear

BLOCKS = 4
CONVOLUTIONS = {1: nn.Conv1d, 2: nn.Conv2d, 3: nn.Conv3d}


class Discriminator(nn.Module):
    """Four stride-2 convolutions and a fully connected layer; LeakyReLU; the first `shared` blocks are shared.

    The blocks after the shared ones, and the last layer, exist once per head (per way of looking or per
    cluster of them). With `shared=4` a head is one row of the last layer. With `bottleneck` a shared layer of
    that many units stands before the heads. With `common` a head's row is the sum of one that all heads share and
    one of its own, which starts at zero: what every way of looking has to teach is learned from all images, and
    heads differ as far as their own images ask for it. The same class looks at images (B, C, H, W), at lines
    (B, C, W) and at volumes (B, X, Y, Z), where all blocks are shared and there is one head.

    Args:
        shape: of one input: (C, H, W), (C, W), or (X, Y, Z) with `volumetric`.
        heads: how many ways of looking.
        channels: after the first block; doubles with every block.
        spectral: spectral normalisation of every layer (Miyato et al. 2018).

    References:
        Li et al. 2019, supplemental, Part I and Fig. 1.
        Miyato & Koyama 2018, cGANs with projection discriminator (the common row and those of its own).

    Raises:
        UserError: for sides that are not multiples of 16, or `common` with `spectral`, which has no rows of zeros.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        heads: int = 1,
        channels: int = 64,
        shared: int = 2,
        spectral: bool = False,
        slope: float = 0.2,
        bottleneck: int = 0,
        common: bool = False,
        volumetric: bool = False,
    ) -> None:
        super().__init__()
        sides = shape if volumetric else shape[1:]
        dims = len(sides)
        if dims not in ((3,) if volumetric else (1, 2)) or any(side < 1 or side % 2**BLOCKS for side in sides):
            raise UserError(f"discriminator: four halvings need sides that are multiples of 16, not {shape}")
        if common and spectral:
            raise UserError("discriminator: rows that start at zero have no spectral norm; choose common or spectral")
        self.slope, self.volumetric = slope, volumetric
        shared = BLOCKS if volumetric or heads == 1 else shared
        widths = [1 if volumetric else shape[0], *[channels * 2**i for i in range(BLOCKS)]]
        convolution = CONVOLUTIONS[dims]
        pairs = list(zip(widths, widths[1:], strict=False))
        self.shared = nn.ModuleList([convolution(a, b, 4, 2, 1) for a, b in pairs[:shared]])
        self.own = nn.ModuleList([HeadConv(heads, a, b, dims) for a, b in pairs[shared:]])
        features = widths[-1] * math.prod(side // 2**BLOCKS for side in sides)
        self.bottleneck = nn.Linear(features, bottleneck) if bottleneck else None
        width = bottleneck or features
        self.last = nn.Embedding(heads, width + 1)
        nn.init.normal_(self.last.weight, std=0.0 if common else width**-0.5)
        self.common = nn.Parameter(torch.randn(width + 1) * width**-0.5) if common else None
        if spectral:
            self._normalise()

    def _normalise(self) -> None:
        for module in self.modules():
            if isinstance(module, (nn.Conv1d, nn.Conv2d, nn.Conv3d, nn.Linear)):
                register_parametrization(module, "weight", SpectralNorm(module.weight.flatten(1)[None]))
            elif isinstance(module, HeadConv):
                register_parametrization(module, "weight", SpectralNorm(module.weight))
            elif isinstance(module, nn.Embedding):
                register_parametrization(module, "weight", SpectralNorm(module.weight[:, None]))

    def forward(self, image: Tensor, head: Tensor) -> Tensor:
        """Logits (B,) of inputs in [0, 1], which are scaled to [-1, 1]; `head` (B,) chooses the head of each."""
        x = (image[:, None] if self.volumetric else image) * 2 - 1
        if x.dim() == 4:
            x = x.contiguous(memory_format=torch.channels_last)
        for convolution in self.shared:
            x = F.leaky_relu(convolution(x), self.slope)
        for convolution in self.own:
            x = F.leaky_relu(convolution(x, head), self.slope)
        x = x.flatten(1)
        if self.bottleneck is not None:
            x = F.leaky_relu(self.bottleneck(x), self.slope)
        row = self.last(head) if self.common is None else self.last(head) + self.common
        return (x * row[:, :-1]).sum(1) + row[:, -1]


class LineDiscriminator(nn.Module):
    """Fully connected, for lines (B, C, D): three hidden layers, a bottleneck, and a row of weights a head.

    Readings are standardised, (y - mean) / deviation: line integrals fill little of [0, 1], and a network that gets
    them as they are hardly learns. A penalty γ |∇_y D|² on the readings asks for deviation² as much of γ. A head's row
    is the sum of one that all heads share and one of its own, which starts at zero. A line has so few readings that
    convolutions have nothing to save: this one takes a third of the time of `Discriminator` and learns more.

    Raises:
        UserError: for inputs that are no lines, or a deviation that is not positive.
    """

    def __init__(
        self,
        shape: tuple[int, ...],
        heads: int = 1,
        mean: float = 0.5,
        deviation: float = 0.5,
        width: int = 512,
        bottleneck: int = 256,
    ) -> None:
        super().__init__()
        if len(shape) != 2 or not deviation > 0:
            raise UserError(
                f"line discriminator: give lines (C, D) and a positive deviation, not {shape} and {deviation:g}"
            )
        self.mean, self.deviation = mean, deviation
        widths = (math.prod(shape), width, width, width, bottleneck)
        self.layers = nn.ModuleList([nn.Linear(a, b) for a, b in zip(widths, widths[1:], strict=False)])
        self.own = nn.Embedding(heads, bottleneck + 1)
        nn.init.zeros_(self.own.weight)
        self.common = nn.Parameter(torch.randn(bottleneck + 1) * bottleneck**-0.5)

    def forward(self, line: Tensor, head: Tensor) -> Tensor:
        """Logits (B,) of lines; `head` (B,) chooses the head of each."""
        x = (line.flatten(1) - self.mean) / self.deviation
        for layer in self.layers:
            x = F.leaky_relu(layer(x), 0.2)
        row = self.own(head) + self.common
        return (x * row[:, :-1]).sum(1) + row[:, -1]


class SpectralNorm(nn.Module):
    """W / σ(W) for every matrix of a stack (heads, O, I), σ by one power iteration a forward pass.

    References:
        Miyato et al. 2018, Spectral Normalization for GANs.
    """

    u: Tensor

    def __init__(self, stack: Tensor) -> None:
        super().__init__()
        start = torch.ones(stack.shape[0], stack.shape[1], device=stack.device)
        self.register_buffer("u", F.normalize(start, dim=1))
        with torch.no_grad():
            for _ in range(15):
                self._iterate(stack)

    def _iterate(self, stack: Tensor) -> Tensor:
        v = F.normalize(torch.bmm(self.u[:, None], stack)[:, 0], dim=1)
        # Not in place: an earlier forward pass of the same step may still need the old vector.
        self.u = F.normalize(torch.bmm(stack, v[:, :, None])[:, :, 0], dim=1)
        return v

    def forward(self, weight: Tensor) -> Tensor:
        # Half precision would round σ, and would turn the buffer u into a half-precision one.
        with torch.autocast(weight.device.type, enabled=False):
            stack = weight.reshape(*self.u.shape, -1)
            with torch.no_grad():
                v = self._iterate(stack)
            sigma = torch.einsum("ho,hoi,hi->h", self.u, stack, v)
            return (stack / sigma[:, None, None]).reshape(weight.shape)


__all__ = ["Discriminator", "LineDiscriminator", "SpectralNorm", "grouped_linear"]
