"""Projection: a pure, differentiable, batched function y = P(x, θ)."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, ClassVar

from torch import Tensor

from .._types import UserError


def _missing_forward(self: Projection, x: Tensor, **latents: Tensor) -> Tensor:
    raise UserError(
        f"{type(self).__name__} defines no forward: add `def forward(self, x, *, latent, ...)`, which returns P(x, θ)"
    )


class Projection:
    """A forward operator: maps what cannot be measured (x) to what can (y).

    A subclass defines `forward(self, x, *, latent, ...)`: x is a batch, each latent a (B,) tensor passed by keyword,
    the result a batch of the same length. It keeps no state, treats each batch element alone and is differentiable in
    x; `unproject.testing.check_projection` tests these laws.

    Class attributes:
        linear: true if P is linear in x; the superposition and adjoint laws are then tested too.
        example_shape: the shape of one x, used by the laws when no example is given.
        silhouettes: whether the pictures are silhouettes, which are compared where they are above ½; others by their
            root mean square differences.
        replayable: whether it does the same operations whatever the values of x and latents, and waits for none of
            them: then a GPU may replay them (`training.graphs`).

    Raises:
        UserError: on use, if the subclass defines no `forward`.

    Examples:
        >>> import torch, unproject as up
        >>> class Depth(up.Projection):
        ...     def forward(self, x, *, azimuth):
        ...         return up.ops.expected_depth(up.ops.rotate_y(x, azimuth))
        >>> Depth().latents
        ('azimuth',)
        >>> Depth()(torch.rand(2, 8, 8, 8), azimuth=torch.zeros(2)).shape
        torch.Size([2, 1, 8, 8])
    """

    linear: ClassVar[bool] = False
    silhouettes: ClassVar[bool] = False
    replayable: ClassVar[bool] = False
    example_shape: ClassVar[tuple[int, ...]] = (8, 8, 8)
    # Declared as torch.nn.Module does, so that a subclass may name its latents without an incompatible override.
    forward: Callable[..., Tensor] = _missing_forward

    def __call__(self, x: Any, **latents: Any) -> Tensor:
        """Return y = P(x, θ)."""
        return self.forward(x, **latents)

    def prepare(self, y: Tensor) -> Tensor:
        """Return a picture as this projection would have made it: what it does to all its pictures, done to y."""
        return y

    def from_measured(self, y: Tensor) -> Tensor:
        """Convert measured pictures (N, ...) to this projection's unit and centre."""
        return y

    @property
    def latents(self) -> tuple[str, ...]:
        """Names of the latent parameters: the keyword-only parameters of `forward`, less the optional ones."""
        if type(self).forward is _missing_forward:
            self.forward(None)
        parameters = inspect.signature(type(self).forward).parameters.values()
        names = (p.name for p in parameters if p.kind is inspect.Parameter.KEYWORD_ONLY)
        return tuple(name for name in names if name not in self.optional_latents)

    @property
    def optional_latents(self) -> tuple[str, ...]:
        """Names of latent parameters that a prior may leave out; none unless a subclass says so."""
        return ()


class Identity(Projection):
    """y = x: direct supervision (3D-GAN; the "high-dimensional" GAN of Li et al. 2019).

    Examples:
        >>> import torch, unproject as up
        >>> x = torch.rand(2, 8, 8, 8)
        >>> up.Identity()(x) is x
        True
    """

    linear = True

    def forward(self, x: Tensor) -> Tensor:
        return x
