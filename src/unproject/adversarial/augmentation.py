"""Augmentation: what is done to all that discriminators see, so that they cannot learn few pictures by heart."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import torch
from torch import Tensor

from .._types import UserError


class Augmentation(ABC):
    """A random change T of pictures, the same kind for real and generated ones, differentiable in the picture.

    The discriminator sees T(y) and T(P(G(z))) alone. If no two distributions of pictures are one after T, the
    generator still learns the pictures as they are: T does not leak.

    References:
        Zhao et al. 2020, Differentiable Augmentation for Data-Efficient GAN Training.
        Karras et al. 2020, Training Generative Adversarial Networks with Limited Data (when augmentations leak).
    """

    @abstractmethod
    def __call__(self, images: Tensor, rng: torch.Generator) -> Tensor:
        """T(images), of the same shape (B, C, ...); each image is changed on its own."""


@dataclass(frozen=True)
class Shift(Augmentation):
    """T(y)(u) = y(u - d), d uniform in ±`pixels` along every side, linear between pixels, 0 from outside.

    Raises:
        UserError: for a shift that is not positive and finite.
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
    """images(u - by) of images (B, ..., D) along the last side, by (B,) in pixels; linear, 0 from outside."""
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
