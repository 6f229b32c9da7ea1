"""Augmentation: random changes of all images that discriminators receive, against overfitting to few real images.

An `Augmentation` is a frozen setting; `begin()` makes its `AugmentationState`, which is part of the checkpoint.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from .._random import chosen_of, shared_draws
from .._types import UserError
from ..ops.resampling import centres, sampled_pictures


class Augmentation(ABC):
    """A random transformation T of real and generated images, differentiable in the image.

    The discriminator receives T(y) and T(P(G(z))) only. If T maps no two distributions of images to the same one, the
    generator still learns the distribution of unchanged images: T does not leak.

    Attributes:
        adaptive: whether its state follows the overfitting, for which panels need held-out images.

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

    adaptive: ClassVar[bool] = False

    @abstractmethod
    def __call__(self, images: Tensor, rng: torch.Generator) -> Tensor:
        """Return T(images), of the same shape (B, C, ...); each image has its own draw."""

    def begin(self) -> AugmentationState:
        """Return the state at the start of a run, of one panel."""
        return AugmentationState(self)


class AugmentationState(nn.Module):
    """An augmentation in one panel of a run; its `state_dict` is part of the checkpoint. This one stays as it is."""

    def __init__(self, settings: Augmentation) -> None:
        super().__init__()
        self.settings = settings

    def forward(self, images: Tensor, rng: torch.Generator) -> Tensor:
        """Return T(images) as of now."""
        return self.settings(images, rng)

    def due(self, draw: int) -> bool:
        """Whether overfitting is measured at this update of the discriminators."""
        return False

    def adapt(self, train: float, held_out: float, generated: float, progress: float) -> None:
        """Take over the discriminator's mean logits of these images, at `progress`, 0 to 1, of the budget."""

    def go_on_from(self, progress: float) -> None:
        """Count the budget from here on: another try has spent what lies before."""

    @property
    def penalty_scale(self) -> float:
        """The factor of the gradient penalty as of now."""
        return 1.0

    def log(self) -> dict[str, Any]:
        """Return fields for the lines of the log."""
        return {}


@dataclass(frozen=True)
class Sometimes(Augmentation):
    """Augment each image with probability `strength` and leave the others bit for bit.

    While some images stay as they are, the distribution of T(y) determines that of y: a strength below 1 does not leak,
    whatever the ranges of `augmentation` (Karras et al. 2020). Smaller ranges instead would not guarantee that.

    Raises:
        UserError: for a strength outside of 0 to 1.

    Examples:
        >>> import torch, unproject as up
        >>> images = torch.rand(100, 1, 8, 8)
        >>> found = up.Sometimes(up.Shift(2.0), 0.3)(images, torch.Generator().manual_seed(0))
        >>> bool(20 < (found != images).flatten(1).any(1).sum() < 40)
        True
    """

    augmentation: Augmentation
    strength: float

    def __post_init__(self) -> None:
        if not 0 <= self.strength <= 1:
            raise UserError(f"strength={self.strength:g}: give 0 to 1")

    def __call__(self, images: Tensor, rng: torch.Generator) -> Tensor:
        source, count, own = shared_draws(rng, len(images))
        chosen = torch.rand(count, generator=source) < self.strength
        rows = chosen[own].nonzero()[:, 0].to(images.device)
        if not chosen.any():
            return images
        rng = chosen_of(rng, chosen, own)
        if not len(rows):  # another process draws, so that this one does
            self.augmentation(images[:1], rng)
            return images
        return images.index_copy(0, rows, self.augmentation(images[rows], rng))


@dataclass(frozen=True)
class Affine(Augmentation):
    """Random shift, zoom and roll of pictures by one bilinear resampling; 0 outside the picture.

    T(y)(u) = y(R(-a) (u - d) / s), u from the centre, with d uniform in ±`shift` times the side along each axis,
    log s uniform in ±log(1 + `zoom`), and a uniform in ±`roll`, counter-clockwise.

    There are no mirror images here: the head of an image is its view, and the mirror image of a silhouette at azimuth a
    is one at -a. `data.with_flips` (`--flips`) adds mirror images to a collection, with their views. A roll changes
    what is upright, so keep it small.

    Args:
        shift: at most, in sides of the picture.
        zoom: at most, 0.1 for 10 % larger or smaller.
        roll: at most, in radians.

    Raises:
        UserError: for a negative range, one too large, or none; when called, for what is no picture (C, H, W).

    Examples:
        >>> import torch, unproject as up
        >>> images = torch.rand(4, 1, 16, 16)
        >>> up.Affine(shift=0.1, zoom=0.1, roll=0.1)(images, torch.Generator().manual_seed(0)).shape
        torch.Size([4, 1, 16, 16])
    """

    shift: float = 0.08
    zoom: float = 0.15
    roll: float = 0.1

    def __post_init__(self) -> None:
        ranges = (self.shift, self.zoom, self.roll)
        if not (all(0 <= value < 1 for value in ranges) and any(ranges)):
            raise UserError(f"{self}: give ranges of 0 to 1 (sides, part, radians), one of them more than 0")

    def __call__(self, images: Tensor, rng: torch.Generator) -> Tensor:
        if images.dim() != 4:
            raise UserError(f"Affine moves pictures (C, H, W), not items of shape {tuple(images.shape[1:])}; use Shift")
        source, count, own = shared_draws(rng, len(images))
        right, down, zoom, roll = torch.rand(4, count, generator=source)[:, own].to(images) * 2 - 1
        by = torch.stack([right, down], 1) * self.shift
        return moved(images, by, (1 + self.zoom) ** zoom, roll * self.roll)


def moved(images: Tensor, by: Tensor, zoom: Tensor, roll: Tensor) -> Tensor:
    """Resample images (B, C, H, W), rolled by `roll` (B,) radians about the centre, zoomed (B,), then shifted.

    `by` (B, 2) is the shift to the right and down, in sides of the picture.
    """
    height, width = images.shape[2:]
    cos, sin = ((value / zoom)[:, None, None] for value in (roll.cos(), roll.sin()))
    right = ((centres(width, images) - 2 * by[:, :1]) * width)[:, None]
    down = ((centres(height, images) - 2 * by[:, 1:]) * height)[:, :, None]
    grid = torch.stack(((right * cos - down * sin) / width, (right * sin + down * cos) / height), -1)
    return sampled_pictures(images, grid)


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
        source, count, own = shared_draws(rng, len(images))
        for side in range(2, images.dim()):
            by = (torch.rand(count, generator=source)[own] * 2 - 1) * self.pixels
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
