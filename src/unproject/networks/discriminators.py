"""Discriminators of real images y and projections P_i(G(z), θ), with one head for each observation i."""

from __future__ import annotations

import math
from typing import Any

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.nn.utils.parametrize import register_parametrization

from .._types import UserError
from .blocks import HeadConv, check_widths

BLOCKS = 4
CONVOLUTIONS = {1: nn.Conv1d, 2: nn.Conv2d, 3: nn.Conv3d}


class Discriminator(nn.Module):
    """Four stride-2 convolutions and a linear layer, with LeakyReLU; the first `shared` blocks are common to all heads.

    The blocks after the shared ones, and the last layer, exist once for each head. The input may be images
    (B, C, H, W), lines (B, C, W) or volumes (B, X, Y, Z); for volumes there is one head and all blocks are shared.

    Args:
        shape: of one input: (C, H, W), (C, W), or (X, Y, Z) with `volumetric`.
        heads: number of heads, one for each observation (or cluster of observations).
        channels: after the first block; they double with every block.
        shared: number of shared blocks; with 4 a head is a row of the last layer.
        spectral: spectral normalisation of every layer (Miyato et al. 2018).
        slope: of LeakyReLU.
        bottleneck: units of a shared layer before the heads (default: no such layer).
        common: the row of a head is the sum of a row common to all heads and one of its own, which starts at 0. What
            observations have in common is then learned from the images of all.
        volumetric: the input is volumes.

    References:
        Li et al. 2019, supplemental, Part I and Fig. 1.
        Miyato & Koyama 2018, cGANs with projection discriminator (the common row and those of its own).

    Raises:
        UserError: for sides that are not multiples of 16, or `common` with `spectral`, whose rows cannot be 0.

    Examples:
        >>> import torch, unproject as up
        >>> discriminator = up.networks.Discriminator((1, 32, 32), heads=16, channels=8)
        >>> discriminator(torch.rand(4, 1, 32, 32), head=torch.tensor([0, 3, 3, 15])).shape
        torch.Size([4])
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
        check_widths("discriminator", channels=channels)
        super().__init__()
        sides = shape if volumetric else shape[1:]
        dims = len(sides)
        if dims not in ((3,) if volumetric else (1, 2)) or any(side < 1 or side % 2**BLOCKS for side in sides):
            raise UserError(
                f"discriminator: four halvings need sides that are multiples of 16, not {shape}; pad them in the "
                "projection, or give a discriminator of your own"
            )
        if common and spectral:
            raise UserError("discriminator: rows that start at zero have no spectral norm; choose common or spectral")
        self.slope, self.volumetric, self.spectral = slope, volumetric, spectral
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

    @property
    def replayable(self) -> bool:
        """Whether all calls do the same operations, so that a GPU may replay them (`training.graphs`): groups of images
        by head differ in size, and spectral normalisation replaces its vectors."""
        return not self.own and not self.spectral

    def forward(self, image: Tensor, head: Tensor) -> Tensor:
        """Return logits (B,) of inputs in [0, 1], which are scaled to [-1, 1]; `head` (B,) is the head of each."""
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


class MultiScaleDiscriminator(nn.Module):
    """Discriminators of an image (B, C, H, W) and of its means over 2², 4², ... pixels; logits are added.

    D(y) = Σ_s D_s(y averaged to s pixels a side), s from `coarsest` to the image's side, and D_s is a `Discriminator`.
    All but the coarsest begin at 0, so that one of twice the size, which took over the weights of this one (`grow`),
    begins as this one.

    Args:
        shape: of one input, (C, H, W).
        heads: number of heads, one for each observation.
        coarsest: the least side.
        settings: of every `Discriminator`; `common` is on.

    References:
        Wang et al. 2018, High-resolution image synthesis and semantic manipulation with conditional GANs (several
        scales); Karras et al. 2018, Progressive growing of GANs.

    Raises:
        UserError: unless sides are `coarsest` times a power of two.

    Examples:
        >>> import torch, unproject as up
        >>> discriminator = up.networks.MultiScaleDiscriminator((1, 64, 64), heads=16, coarsest=32, channels=8)
        >>> discriminator(torch.rand(4, 1, 64, 64), head=torch.tensor([0, 3, 3, 15])).shape
        torch.Size([4])
    """

    def __init__(self, shape: tuple[int, ...], heads: int = 1, coarsest: int = 32, **settings: Any) -> None:
        super().__init__()
        channels, height, width = shape
        scales = round(math.log2(height / coarsest)) + 1 if height >= coarsest else 0
        if scales < 1 or height != width or height != coarsest * 2 ** (scales - 1):
            raise UserError(f"discriminator: {height} x {width} is not {coarsest} a side, times a power of two")
        sides = [coarsest * 2**i for i in range(scales)]
        self.scales = nn.ModuleList(
            [Discriminator((channels, side, side), heads, **{**settings, "common": True}) for side in sides]
        )
        for finer in list(self.scales)[1:]:
            nn.init.zeros_(finer.get_parameter("common"))

    @property
    def replayable(self) -> bool:
        return all(scale.replayable for scale in self.scales)

    def forward(self, image: Tensor, head: Tensor) -> Tensor:
        """Return logits (B,) of images in [0, 1]; `head` (B,) is the head of each."""
        logits = self.scales[-1](image, head)
        for coarser in reversed(list(self.scales)[:-1]):
            image = F.avg_pool2d(image, 2)
            logits = logits + coarser(image, head)
        return logits

    def grow(self, weights: dict[str, Tensor]) -> None:
        """Take over the weights of one of half the size, a `Discriminator` of the least side among them.

        Raises:
            UserError: if they are of no such discriminator.
        """
        own = {
            name: v for name, v in self.state_dict().items() if not name.startswith(f"scales.{len(self.scales) - 1}.")
        }
        if len(self.scales) == 2 and not any(name.startswith("scales.") for name in weights):
            weights = {f"scales.0.{name}": value for name, value in weights.items()}
        if {name: v.shape for name, v in own.items()} != {name: v.shape for name, v in weights.items()}:
            raise UserError("the weights are of no such discriminator of images of half the side")
        self.load_state_dict(self.state_dict() | weights)


class LineDiscriminator(nn.Module):
    """A fully connected discriminator of lines (B, C, D): three hidden layers, a bottleneck, a row of weights a head.

    Readings are standardised, (y - mean) / deviation, since line integrals occupy a small part of [0, 1]. The gradient
    norm is by the readings as given, so a gradient penalty of the same strength has γ · deviation². The row of a head
    is the sum of a common row and one of its own, which starts at 0. For lines of tens of readings this network takes a
    third of the time of `Discriminator`, with better results.

    Args:
        shape: (C, D) of one line.
        heads: number of heads, one for each observation.
        mean, deviation: of the readings.
        width: of the hidden layers.
        bottleneck: units before the heads.

    Raises:
        UserError: for inputs that are not lines, or a deviation that is not positive.

    Examples:
        >>> import torch, unproject as up
        >>> discriminator = up.networks.LineDiscriminator((1, 32), heads=10)
        >>> discriminator(torch.rand(4, 1, 32), head=torch.tensor([0, 3, 3, 9])).shape
        torch.Size([4])
    """

    replayable = True

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
        """Return logits (B,) of lines; `head` (B,) is the head of each."""
        x = (line.flatten(1) - self.mean) / self.deviation
        for layer in self.layers:
            x = F.leaky_relu(layer(x), 0.2)
        row = self.own(head) + self.common
        return (x * row[:, :-1]).sum(1) + row[:, -1]


class SpectralNorm(nn.Module):
    """Spectral normalisation W / σ(W) of each matrix of a stack (heads, O, I), σ by one power iteration a forward pass.

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
        # In half precision σ would be rounded and the buffer u would become half precision.
        with torch.autocast(weight.device.type, enabled=False):
            stack = weight.reshape(*self.u.shape, -1)
            with torch.no_grad():
                v = self._iterate(stack)
            sigma = torch.einsum("ho,hoi,hi->h", self.u, stack, v)
            return (stack / sigma[:, None, None]).reshape(weight.shape)
