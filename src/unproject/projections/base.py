"""Projection: a pure, differentiable, batched function y = P(x, θ)."""

from __future__ import annotations

import inspect
from abc import ABC, abstractmethod
from typing import Any, ClassVar

from torch import Tensor


class Projection(ABC):
    """A forward operator: maps what cannot be measured (x) to what can (y).

    A subclass defines `forward(self, x, *, latent, ...)`: x is a batch, every latent a (B,) tensor passed
    by keyword, the result a batch of the same length. It keeps no state, treats each batch element alone
    and is differentiable in x; `unproject.testing.check_projection` tests that.

    Class attributes:
        linear: true if P is linear in x; the superposition and adjoint laws are then tested too.
        example_shape: the shape of one x, used by the laws when no example is given.
    """

    linear: ClassVar[bool] = False
    example_shape: ClassVar[tuple[int, ...]] = (8, 8, 8)

    @abstractmethod
    def forward(self, x: Tensor, **latents: Tensor) -> Tensor:
        """Return y = P(x, θ)."""

    def __call__(self, x: Tensor, **latents: Any) -> Tensor:
        return self.forward(x, **latents)

    @property
    def latents(self) -> tuple[str, ...]:
        """Names of the latent parameters: the keyword-only parameters of `forward`."""
        parameters = inspect.signature(type(self).forward).parameters.values()
        return tuple(p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY)


class Identity(Projection):
    """y = x: direct supervision (3D-GAN, the paper's "high-dimensional" GAN)."""

    linear = True

    def forward(self, x: Tensor) -> Tensor:  # pyright: ignore[reportIncompatibleMethodOverride]
        return x
