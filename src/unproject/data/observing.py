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


def observe(
    things: Records | Tensor,
    looks: Sequence[Look],
    each: int = 1,
    seed: int = 0,
    *,
    binary: bool = False,
    chunk: int = 64,
) -> Collection:
    """Look at every thing `each` times, each time in one of the ways of looking, all as likely.

    Observations (N · each, ...), those of a thing side by side, with the latents as drawn, and the index of
    the way of looking as `latents["look"]`: leave latents out for views to be unknown.

    Args:
        things: (N, ...), what the projections take: volumes, or images.
        looks: Observations, or anything with a projection and a prior; they must draw the same latents.
        each: observations of a thing.
        seed: the draws are a function of the seed.
        binary: cut what is seen at one half.
        chunk: observations made at once.

    Raises:
        UserError: if there is no look, or looks draw different latents.
    """
    things = things if isinstance(things, Records) else Records.from_tensor(things)
    if not looks or each < 1:
        raise UserError("observe: give at least one way of looking, and at least one look at each thing")
    rows = torch.arange(len(things)).repeat_interleave(each)
    parts = [
        _look_at(things.items[some], looks, generator_at(seed, step, "render"))
        for step, some in enumerate(rows.split(chunk))
    ]
    if len({frozenset(latents) for _, latents in parts}) != 1:
        raise UserError("observe: the ways of looking draw different latents; render them one by one")
    images = torch.cat([image for image, _ in parts])
    latents = {name: torch.cat([latents[name] for _, latents in parts]) for name in parts[0][1]}
    names = [f"{name}#{k}" for name in things.names for k in range(each)]
    images = (images >= 0.5).float() if binary else images
    return Collection.from_tensor(images, latents, names, source=f"{things.source}, rendered")


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
        raise UserError("observe: the ways of looking draw different latents; render them one by one")
    back = torch.cat(order).argsort()
    latents = {name: torch.cat([theta[name] for theta in drawn])[back] for name in drawn[0]}
    return torch.cat(images)[back], {**latents, "look": which.float()}
