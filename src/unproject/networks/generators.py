"""Generators x = G(z), z ~ N(0, 1), of volumes and images."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from functools import partial
from typing import ClassVar, Literal

import torch
from torch import Tensor, nn

from .._random import generator_at
from .._types import UserError
from ..ops.hull import visual_hull
from .blocks import (
    SmoothUpsampling,
    Upsampling,
    check_widths,
    halved_widths,
    inscribed_disc,
    upsampling_levels,
    volume_doubling,
    volume_norm,
)

FINE_VOXELS = 64 * 64**3
"""Voxels of another size that are generated at once, at least one sample: as many as of 64 samples of 64³."""


class Generator(nn.Module, ABC):
    """A module that maps codes (B, code_size) to samples x, and that draws its own codes.

    Class attributes:
        domain: "volumes", "images" or "maps"; of something else the recipe has one (`Recipe(domain=...)`).
        replayable: whether forward does the same operations whatever is in codes, parameters and buffers, on which
            alone it depends, and waits for none of them: then a GPU may replay them (`training.graphs`).

    Args:
        code_size: L, the length of a code.
        truncation: the bound of |z| in `sample`, a truncated normal distribution (default: none).
        hull: `sample` returns the visual hull of volumes (`ops.visual_hull`). Silhouettes at elevation 0 determine a
            volume up to its hull, so cavities of a sample are arbitrary. A number is the density of silhouettes by
            absorption, by which fog looks solid. Runs whose cameras are not level turn it off.

    Attributes:
        white: number of trailing entries of a latent that are noise of mean 0 and deviation 1.

    Examples:
        >>> import torch, unproject as up
        >>> class Blobs(up.Generator):
        ...     domain = "images"
        ...     def __init__(self):
        ...         super().__init__(code_size=4)
        ...         self.layer = torch.nn.Linear(4, 16 * 16)
        ...     def forward(self, code):
        ...         return self.layer(code).sigmoid().view(-1, 1, 16, 16)
        >>> Blobs().sample(3, seed=1).shape
        torch.Size([3, 1, 16, 16])
    """

    domain: ClassVar[Literal["", "volumes", "images", "maps"]] = ""
    replayable: ClassVar[bool] = False

    def __init__(self, code_size: int, truncation: float | None = None, hull: bool | float = False) -> None:
        super().__init__()
        self.code_size = code_size
        self.white = 0
        self.truncation = truncation
        self.hull = hull

    def filled(self, x: Tensor, times: float = 1.0) -> Tensor:
        """Return the hull of samples, if that is what is sampled; voxels are `times` as fine as the generator's own."""
        return visual_hull(x, density=None if self.hull is True else self.hull / times) if self.hull else x

    @abstractmethod
    def forward(self, code: Tensor) -> Tensor:
        """Return x = G(z)."""

    def map_code(self, code: Tensor) -> Tensor:
        """Return the latents (B, D) that `synthesise` makes samples of: codes, or what a mapping network makes of them.

        A sample that fits pictures is searched among latents (`unproject.inversion`).
        """
        return code

    def synthesise(self, latent: Tensor) -> Tensor:
        """Return the samples of latents, G(z) = synthesise(map_code(z))."""
        return self(latent)

    def draw(self, n: int, rng: torch.Generator) -> Tensor:
        """Draw n codes z ~ N(0, 1), (n, code_size)."""
        return torch.randn(n, self.code_size, generator=rng)

    def codes(self, n: int, seed: int = 0) -> Tensor:
        """Return the codes (n, code_size) of the samples of this seed."""
        return torch.cat([self._one_code(seed, i) for i in range(n)])

    def at_size(self, code: Tensor, size: int) -> Tensor:
        """Return x = G(z) of `size` a side, as finely as the generator can; most have one size only.

        Raises:
            UserError: if the generator cannot make that size.
        """
        raise UserError(f"size {size}: {type(self).__name__} makes samples of one size; leave size out")

    @torch.no_grad()
    def sample(self, n: int, seed: int = 0, batch: int = 64, size: int | None = None) -> Tensor:
        """Return n samples, generated in evaluation mode, on the CPU; sample i depends on (seed, i) only, not on n.

        It does not depend on `batch` either, up to rounding, unless batch norm uses the statistics of the batch.

        Args:
            n: how many.
            seed: which.
            batch: how many at once; of another size fewer, so that they take no more memory than 64 do at 64³.
            size: a side of samples, in voxels or texels (default: the generator's own; see `at_size`).

        Raises:
            UserError: for a negative n, a batch of none, or a size that the generator cannot make.
        """
        if n < 0 or batch < 1:
            raise UserError(f"{n} samples, {batch} at once: give 0 or more, and 1 or more at once")
        make = self if size is None else partial(self.at_size, size=size)
        times = 1.0 if size is None else size / getattr(self, "size", size)
        batch = batch if size is None else max(min(batch, FINE_VOXELS // max(size, 1) ** 3), 1)
        device = next(self.parameters()).device
        # Batches are always full: neither rounding nor batch statistics may depend on n.
        codes = self.codes(max(n + -n % batch, batch), seed)
        training = self.training
        self.eval()
        try:
            parts = (make(part.to(device)).float() for part in codes.split(batch))
            return torch.cat([self.filled(x, times).cpu() for x in parts])[:n]
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
    """Return the left-right symmetric volume whose left half is that of x (B, X, Y, Z), X even."""
    return reflect(x[:, : x.shape[1] // 2])


def reflect(half: Tensor, axis: int = 1) -> Tensor:
    """Return the volume whose first half along `axis` is `half`, (B, X/2, Y, Z), and whose second half mirrors it."""
    return torch.cat([half, half.flip(axis)], axis)


class VoxelGenerator(Generator):
    """A generator of volumes by 3-D convolutions from 4³ to size³, each with batch norm and ReLU: the paper's.

    A linear layer gives `channels`×4³; every level doubles the side and halves the channels. A last 3³ convolution and
    (tanh + 1)/2 give occupancy.

    Args:
        size: side of the volume, 4·2^k.
        code_size: length of a code.
        channels: at 4³.
        upsampling: "transposed", the 4³ stride-2 transposed convolution of the released code, or "nearest", the paper's
            nearest-neighbour upsampling and convolution.
        mirror: generate the left half only and reflect it.
        truncation: see `Generator`.
        batch_statistics: batch norm uses the statistics of the batch in evaluation mode too, as the released code does;
            a sample then depends on the others of its batch.

    References:
        Li et al. 2019, supplemental, Part I and Fig. 1; Wu et al. 2016 (3D-GAN).

    Raises:
        UserError: for another size or upsampling.

    Examples:
        >>> import torch, unproject as up
        >>> generator = up.networks.VoxelGenerator(size=16, code_size=8, channels=16)
        >>> generator(generator.draw(2, torch.Generator().manual_seed(0))).shape
        torch.Size([2, 16, 16, 16])
    """

    domain = "volumes"
    replayable = True

    def __init__(
        self,
        size: int = 64,
        code_size: int = 256,
        channels: int = 512,
        upsampling: Upsampling = "transposed",
        mirror: bool = False,
        truncation: float | None = None,
        batch_statistics: bool = False,
    ) -> None:
        check_widths(type(self).__name__, code_size=code_size, channels=channels)
        super().__init__(code_size, truncation)
        widths = halved_widths(channels, upsampling_levels(size))
        self.mirror, self.width = mirror, channels
        self.start = nn.Linear(code_size, channels * 4**3)
        layers: list[nn.Module] = [volume_norm(channels, batch_statistics), nn.ReLU()]
        for before, after in zip(widths, widths[1:], strict=False):
            layers += [volume_doubling(before, after, upsampling), volume_norm(after, batch_statistics), nn.ReLU()]
        self.levels = nn.Sequential(*layers, nn.Conv3d(widths[-1], 1, 3, padding=1))

    def forward(self, code: Tensor) -> Tensor:
        x = self.start(code).view(len(code), self.width, 4, 4, 4)
        x = (torch.tanh(self.levels(x)[:, 0]) + 1) / 2
        return reflect_half(x) if self.mirror else x


class ImageGenerator(Generator):
    """DCGAN: images (B, outputs, size, size) in [0, 1] by transposed convolutions from 4², batch norm and ReLU.

    A linear layer gives `channels`×4²; every level doubles the side and halves the channels, down to 8. A last 3²
    convolution and a sigmoid give the image.

    Args:
        size: side of the image, 4·2^k.
        code_size: length of a code.
        channels: at 4².
        outputs: channels of the image.
        bias: initial bias of the last convolution; a negative one gives dark images, as most images learned from line
            integrals are.
        truncation: see `Generator`.

    References:
        Radford et al. 2016, Unsupervised representation learning with deep convolutional GANs.

    Examples:
        >>> import torch, unproject as up
        >>> generator = up.networks.ImageGenerator(size=16, code_size=8, channels=16)
        >>> generator.sample(3, seed=0).shape
        torch.Size([3, 1, 16, 16])
    """

    domain = "images"
    replayable = True

    def __init__(
        self,
        size: int = 32,
        code_size: int = 128,
        channels: int = 256,
        outputs: int = 1,
        bias: float = -2.0,
        truncation: float | None = None,
    ) -> None:
        check_widths(type(self).__name__, code_size=code_size, channels=channels)
        super().__init__(code_size, truncation)
        widths = halved_widths(channels, upsampling_levels(size))
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
    """Images (B, outputs, size, size) in [0, 1] by smooth upsampling from 4², with the code at every level.

    Transposed convolutions leave checkerboard artefacts, to which line integrals are insensitive, so that training does
    not remove them.

    Args:
        size, code_size, channels, outputs, bias, truncation: as in `ImageGenerator`.
        disc: images are 0 outside of the inscribed disc, which is all that line integrals in every direction see. Where
            directions are unknown, specks in the corners would tell them, and hardly a line shows those.

    Examples:
        >>> import torch, unproject as up
        >>> generator = up.networks.SmoothImageGenerator(size=16, code_size=8, channels=16)
        >>> generator.sample(3, seed=0).shape
        torch.Size([3, 1, 16, 16])
    """

    domain = "images"
    replayable = True
    seen: Tensor | None

    def __init__(
        self,
        size: int = 32,
        code_size: int = 128,
        channels: int = 256,
        outputs: int = 1,
        bias: float = -2.0,
        truncation: float | None = None,
        disc: bool = False,
    ) -> None:
        check_widths(type(self).__name__, code_size=code_size, channels=channels)
        super().__init__(code_size, truncation)
        self.levels = SmoothUpsampling(code_size, channels, outputs, (size, size), upsampling_levels(size))
        nn.init.constant_(self.levels.last.bias, bias)  # pyright: ignore[reportArgumentType]
        self.register_buffer("seen", inscribed_disc(size) if disc else None, persistent=False)

    def forward(self, code: Tensor) -> Tensor:
        x = torch.sigmoid(self.levels(code)).contiguous()
        return x if self.seen is None else x * self.seen
