"""Generator: x = G(z), z ~ N(0, 1): a sample of what cannot be measured, from a code."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import ClassVar

import torch
from torch import Tensor, nn

from .._random import generator_at
from .._types import UserError
from ..ops.hull import visual_hull
from .blocks import SmoothUpsampling, upsampling_levels


class Generator(nn.Module, ABC):
    """A module that turns codes (B, code_size) into samples x, and that draws its own codes.

    Class attributes:
        domain: what it makes: "volumes", "images" or "maps"; or nothing, if recipes say so (`Recipe(domain=...)`).

    Args:
        code_size: L, the length of a code.
        truncation: codes are drawn with |z| ≤ truncation (a truncated normal) when sampling; None: not at all.
        hull: sampled volumes are filled where no level view could tell (`ops.visual_hull`): level silhouettes
            bind a volume from outside only, and what they leave open is better solid than hollow.
    """

    domain: ClassVar[str] = ""

    def __init__(self, code_size: int, truncation: float | None = None, hull: bool = False) -> None:
        super().__init__()
        self.code_size = code_size
        self.truncation = truncation
        self.hull = hull

    @abstractmethod
    def forward(self, code: Tensor) -> Tensor:
        """x = G(z)."""

    def draw(self, n: int, rng: torch.Generator) -> Tensor:
        """n codes z ~ N(0, 1), (n, code_size)."""
        return torch.randn(n, self.code_size, generator=rng)

    @torch.no_grad()
    def sample(self, n: int, seed: int = 0, batch: int = 64) -> Tensor:
        """n samples in evaluation mode, on the CPU; sample i is the same whatever n is.

        It is the same for every `batch` too, up to rounding, unless batch norm uses the batch's own statistics.
        """
        device = next(self.parameters()).device
        # Whole batches of true codes: neither rounding nor statistics of a batch may depend on n.
        codes = torch.cat([self._one_code(seed, i) for i in range(max(n + -n % batch, batch))])
        training = self.training
        self.eval()
        try:
            parts = (self(part.to(device)).float() for part in codes.split(batch))
            return torch.cat([(visual_hull(x) if self.hull else x).cpu() for x in parts])[:n]
        finally:
            self.train(training)

    def _one_code(self, seed: int, i: int) -> Tensor:
        rng = generator_at(seed, i, "sample")
        if self.truncation is None:
            return self.draw(1, rng)
        bound = math.erf(self.truncation / math.sqrt(2))
        uniform = (torch.rand(1, self.code_size, generator=rng) * 2 - 1) * bound
        return torch.erfinv(uniform) * math.sqrt(2)


def reflect_half(x: Tensor) -> Tensor:
    """The left-right symmetric volume whose left half is that of x (B, X, Y, Z), X even."""
    return reflect(x[:, : x.shape[1] // 2])


def reflect(left: Tensor) -> Tensor:
    """The volume whose left half is `left` (B, X/2, Y, Z) and whose right half is its mirror image."""
    return torch.cat([left, left.flip(1)], 1)


class VoxelGenerator(Generator):
    """The paper's generator: 3-D convolutions from 4³ to size³, batch norm and ReLU after each.

    A linear layer gives `channels`×4³; every level doubles the side and halves the channels. `upsampling`
    "transposed" is the released 4³ stride-2 transposed convolution, "nearest" the paper's upsample + convolution.
    A last 3³ convolution and (tanh + 1)/2 give occupancy.

    Args:
        size: side of the volume, 4·2^k.
        mirror: generate the left half only and reflect it.
        batch_statistics: batch norm uses the batch's own statistics at inference too, as the released code does;
            a sample then depends on the others of its batch, so it is not generated alone.

    References:
        Li et al. 2019, supplemental, Part I and Fig. 1; Wu et al. 2016 (3D-GAN).
    """

    domain = "volumes"

    def __init__(
        self,
        size: int = 64,
        code_size: int = 256,
        channels: int = 512,
        upsampling: str = "transposed",
        mirror: bool = False,
        truncation: float | None = None,
        batch_statistics: bool = False,
    ) -> None:
        super().__init__(code_size, truncation)
        widths = [max(channels // 2**i, 8) for i in range(upsampling_levels(size) + 1)]
        self.mirror, self.width = mirror, channels
        self.start = nn.Linear(code_size, channels * 4**3)
        layers: list[nn.Module] = [_norm(channels, batch_statistics), nn.ReLU()]
        for before, after in zip(widths, widths[1:], strict=False):
            layers += [_doubling(before, after, upsampling), _norm(after, batch_statistics), nn.ReLU()]
        self.levels = nn.Sequential(*layers, nn.Conv3d(widths[-1], 1, 3, padding=1))

    def forward(self, code: Tensor) -> Tensor:
        x = self.start(code).view(len(code), self.width, 4, 4, 4)
        x = (torch.tanh(self.levels(x)[:, 0]) + 1) / 2
        return reflect_half(x) if self.mirror else x


def _norm(channels: int, batch_statistics: bool) -> nn.BatchNorm3d:
    return nn.BatchNorm3d(channels, track_running_stats=not batch_statistics)


def _doubling(before: int, after: int, upsampling: str) -> nn.Module:
    if upsampling == "transposed":
        return nn.ConvTranspose3d(before, after, 4, 2, 1)
    if upsampling == "nearest":
        return nn.Sequential(nn.Upsample(scale_factor=2), nn.Conv3d(before, after, 3, padding=1))
    raise UserError(f"upsampling={upsampling!r}: choose 'transposed' or 'nearest'")


class ImageGenerator(Generator):
    """DCGAN: an image (B, outputs, size, size) in [0, 1] from 4², by transposed convolutions, batch norm and ReLU.

    A linear layer gives `channels`×4²; every level doubles the side and halves the channels, down to 8 at least.
    A last 3² convolution and a sigmoid give the image.

    Args:
        size: side of the image, 4·2^k.
        bias: of the last convolution at the start; negative makes dark images, as most of those learned from
            line integrals are mostly dark.

    References:
        Radford et al. 2016, Unsupervised representation learning with deep convolutional GANs.
    """

    domain = "images"

    def __init__(
        self,
        size: int = 32,
        code_size: int = 128,
        channels: int = 256,
        outputs: int = 1,
        bias: float = -2.0,
        truncation: float | None = None,
    ) -> None:
        super().__init__(code_size, truncation)
        widths = [max(channels // 2**i, 8) for i in range(upsampling_levels(size) + 1)]
        self.width = channels
        self.start = nn.Linear(code_size, channels * 4**2)
        layers: list[nn.Module] = [nn.BatchNorm2d(channels), nn.ReLU()]
        for before, after in zip(widths, widths[1:], strict=False):
            layers += [nn.ConvTranspose2d(before, after, 4, 2, 1), nn.BatchNorm2d(after), nn.ReLU()]
        last = nn.Conv2d(widths[-1], outputs, 3, padding=1)
        nn.init.constant_(last.bias, bias)  # pyright: ignore[reportArgumentType]
        self.levels = nn.Sequential(*layers, last)

    def forward(self, code: Tensor) -> Tensor:
        x = self.start(code).view(len(code), self.width, 4, 4)
        return torch.sigmoid(self.levels(x.contiguous(memory_format=torch.channels_last))).contiguous()


class SmoothImageGenerator(Generator):
    """An image (B, outputs, size, size) in [0, 1] by smooth upsampling from 4², the code heard at every level.

    Transposed convolutions leave a checkerboard; line integrals hardly see it, so nothing ever takes it away.

    Args:
        size, outputs, bias: as in `ImageGenerator`.
        channels: of the 4² level.
    """

    domain = "images"

    def __init__(
        self,
        size: int = 32,
        code_size: int = 128,
        channels: int = 256,
        outputs: int = 1,
        bias: float = -2.0,
        truncation: float | None = None,
    ) -> None:
        super().__init__(code_size, truncation)
        self.levels = SmoothUpsampling(code_size, channels, outputs, (size, size), upsampling_levels(size))
        nn.init.constant_(self.levels.last.bias, bias)  # pyright: ignore[reportArgumentType]

    def forward(self, code: Tensor) -> Tensor:
        return torch.sigmoid(self.levels(code)).contiguous()


class LowRankGenerator(Generator):
    """Occupancy as a sum of plane × line products, for CPUs and for large volumes.

    logit[x, y, z] = b + r^-½ Σ_r (P_xy[r] L_z[r] + P_yz[r] L_x[r] + P_xz[r] L_y[r]) and p = sigmoid(logit).
    The planes come from 2-D convolutions and the lines from 1-D ones, so that the cost grows with size²
    rather than size³. Every upsampling is smooth: transposed convolutions alone leave a checkerboard in the
    factors, and volumes come out striped inside while their silhouettes look right.

    Args:
        size: side of the volume, 4·2^k.
        mirror: generate the left half only and reflect it; that costs a third less.
        rank: number of products per axis.
        bias: b at the start; negative, so that training starts from nearly transparent volumes: an opaque
            one has no gradient, every ray being saturated.

    References:
        The plane-line factorisation is the VM decomposition of Chen et al. 2022 (TensoRF).
    """

    domain = "volumes"

    def __init__(
        self,
        size: int = 32,
        code_size: int = 128,
        channels: int = 128,
        rank: int = 32,
        mirror: bool = False,
        bias: float = -5.0,
        truncation: float | None = None,
        hull: bool = False,
    ) -> None:
        super().__init__(code_size, truncation, hull)
        hidden = 256
        self.mirror, self.scale = mirror, rank**-0.5
        self.mapping = nn.Sequential(
            nn.Linear(code_size, hidden), nn.LeakyReLU(0.2), nn.Linear(hidden, hidden), nn.LeakyReLU(0.2)
        )
        levels, width = upsampling_levels(size), size // 2 if mirror else size
        planes, lines = ((width, size), (size, size), (width, size)), ((size,), (width,), (size,))
        self.planes = nn.ModuleList([SmoothUpsampling(hidden, channels, rank, shape, levels) for shape in planes])
        self.lines = nn.ModuleList([SmoothUpsampling(hidden, channels, rank, shape, levels) for shape in lines])
        self.bias = nn.Parameter(torch.tensor(float(bias)))

    def logits(self, code: Tensor) -> Tensor:
        """The logit of occupancy, (B, X, Y, Z), or of the left half of it with `mirror`."""
        hidden = self.mapping(code)
        xz, zy, xy = (plane(hidden) for plane in self.planes)
        along_y, along_x, along_z = (line(hidden) for line in self.lines)
        # Summed as (B, X, Z, Y): level silhouettes read columns, which are contiguous then.
        total = torch.bmm(xz.flatten(2).transpose(1, 2), along_y).unflatten(1, xz.shape[2:])
        total = total + torch.bmm(along_x.transpose(1, 2), zy.flatten(2)).unflatten(2, zy.shape[2:])
        total = total + along_z.transpose(1, 2)[:, None] @ xy.transpose(1, 2)
        return (total * self.scale + self.bias).transpose(2, 3)

    def forward(self, code: Tensor) -> Tensor:
        x = torch.sigmoid(self.logits(code))
        return reflect(x) if self.mirror else x
