"""Collections seen of shapes: what a camera would have collected, with the true views kept."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError
from .collection import Collection
from .records import Records


class Sampler(Protocol):
    """A prior: draws n latents by name."""

    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]: ...


class Look(Protocol):
    """What an `Observation` is: a projection and a prior over its latents."""

    @property
    def projection(self) -> Any: ...

    @property
    def prior(self) -> Sampler: ...


def render_silhouettes(
    shapes: Records | Tensor,
    looks: Sequence[Look],
    per_shape: int = 1,
    seed: int = 0,
    *,
    binary: bool = False,
    chunk: int = 64,
) -> Collection:
    """Look at every shape `per_shape` times, each time in one of the ways of looking, all as likely.

    Images (N · per_shape, C, H, W), those of a shape side by side, with the latents as drawn, and the index of
    the way of looking as `latents["look"]`: leave latents out for views to be unknown.

    Args:
        shapes: volumes (N, X, Y, Z).
        looks: Observations, or anything with a projection and a prior; they must draw the same latents.
        per_shape: images a shape.
        seed: the draws are a function of the seed.
        binary: cut images at one half.
        chunk: images rendered at once.

    Raises:
        UserError: if there is no look, or looks draw different latents.
    """
    shapes = shapes if isinstance(shapes, Records) else Records.from_tensor(shapes)
    if not looks or per_shape < 1:
        raise UserError("render_silhouettes: give at least one way of looking and one image a shape")
    rows = torch.arange(len(shapes)).repeat_interleave(per_shape)
    parts = [
        _look_at(shapes.items[some], looks, generator_at(seed, step, "render"))
        for step, some in enumerate(rows.split(chunk))
    ]
    if len({frozenset(latents) for _, latents in parts}) != 1:
        raise UserError("render_silhouettes: the ways of looking draw different latents; render them one by one")
    images = torch.cat([image for image, _ in parts])
    latents = {name: torch.cat([latents[name] for _, latents in parts]) for name in parts[0][1]}
    names = [f"{name}#{k}" for name in shapes.names for k in range(per_shape)]
    images = (images >= 0.5).float() if binary else images
    return Collection.from_tensor(images, latents, names, source=f"{shapes.source}, rendered")


@torch.no_grad()
def _look_at(x: Tensor, looks: Sequence[Look], rng: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
    """Images of a batch and their latents, grouped by way of looking and put back in order."""
    which = torch.randint(len(looks), (len(x),), generator=rng)
    images, drawn, order = [], [], []
    for k in which.unique().tolist():
        rows = (which == k).nonzero()[:, 0]
        theta = looks[k].prior.sample(len(rows), rng)
        images.append(looks[k].projection(x[rows], **theta))
        drawn.append(theta)
        order.append(rows)
    if len({frozenset(theta) for theta in drawn}) != 1:
        raise UserError("render_silhouettes: the ways of looking draw different latents; render them one by one")
    back = torch.cat(order).argsort()
    latents = {name: torch.cat([theta[name] for theta in drawn])[back] for name in drawn[0]}
    return torch.cat(images)[back], {**latents, "look": which.float()}
