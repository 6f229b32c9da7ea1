"""Augmentation: random changes of all images that discriminators receive, against overfitting to few real images."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch
from torch import Tensor

from .._types import UserError


class Augmentation(ABC):
    """A random transformation T of real and generated images, differentiable in the image.

    The discriminator receives T(y) and T(P(G(z))) only. If T maps no two distributions of images to the same one, the
    generator still learns the distribution of unchanged images: T does not leak.

    References:
        Zhao et al. 2020, Differentiable Augmentation for Data-Efficient GAN Training.
        Karras et al. 2020, Training Generative Adversarial Networks with Limited Data (when augmentations leak).

    Examples:
        >>> import torch, unproject as up
        >>> class Brightness(up.Augmentation):
        ...     def __call__(self, images, rng):
        ...         by = torch.rand(len(images), generator=rng) * 0.2 - 0.1
        ...         return images + by.to(images).view(-1, *[1] * (images.dim() - 1))
        >>> Brightness()(torch.zeros(4, 1, 8, 8), torch.Generator().manual_seed(0)).shape
        torch.Size([4, 1, 8, 8])
    """

    @abstractmethod
    def __call__(self, images: Tensor, rng: torch.Generator) -> Tensor:
        """Return T(images), of the same shape (B, C, ...); each image has its own draw."""


@dataclass(frozen=True)
class Shift(Augmentation):
    """Random translation: T(y)(u) = y(u - d), d uniform in ±`pixels` along each axis.

    Linear interpolation between pixels; 0 outside the image.

    Raises:
        UserError: for a shift that is not positive and finite.

    Examples:
        >>> import torch, unproject as up
        >>> images = torch.rand(4, 1, 8, 8)
        >>> up.Shift(2.0)(images, torch.Generator().manual_seed(0)).shape
        torch.Size([4, 1, 8, 8])
    """

    pixels: float

    def __post_init__(self) -> None:
        if not 0 < self.pixels < float("inf"):
            raise UserError(f"shift={self.pixels:g}: give pixels, more than 0")

    def __call__(self, images: Tensor, rng: torch.Generator) -> Tensor:
        for side in range(2, images.dim()):
            by = (torch.rand(len(images), generator=rng) * 2 - 1) * self.pixels
            images = shifted(images.transpose(side, -1), by.to(images)).transpose(side, -1)
        return images


def shifted(images: Tensor, by: Tensor) -> Tensor:
    """Translate images (B, ..., D) along the last axis by `by` (B,) pixels: images(u - by); linear, 0 outside."""
    length = images.shape[-1]
    at = torch.arange(length, device=images.device) - by[:, None]
    first = at.floor()

    def pixel(number: Tensor) -> Tensor:
        inside = (number >= 0) & (number < length)
        shape = (len(images), *[1] * (images.dim() - 2), length)
        rows = number.clamp(0, length - 1).long().view(shape).expand(images.shape)
        return images.gather(-1, rows) * inside.view(shape)

    part = (at - first).view(len(images), *[1] * (images.dim() - 2), length)
    return torch.lerp(pixel(first), pixel(first + 1), part)
