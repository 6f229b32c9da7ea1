"""Collections rendered of known items: what a camera would have collected, with the true views kept."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import torch
from torch import Tensor

from .._random import generator_at
from .._types import UserError
from .collection import Collection


class Sampler(Protocol):
    """A prior: draws n latents by name."""

    def sample(self, n: int, rng: torch.Generator) -> dict[str, Tensor]: ...


class Observing(Protocol):
    """What an `Observation` is: a projection and a prior over its latents."""

    @property
    def projection(self) -> Any: ...

    @property
    def prior(self) -> Sampler: ...


def observe(
    items: Collection | Tensor,
    observations: Sequence[Observing],
    each: int = 1,
    seed: int = 0,
    *,
    binary: bool = False,
    chunk: int = 64,
) -> Collection:
    """Project every item `each` times, each time by one of the observations, all equally likely.

    The result holds N · each projections, those of an item side by side, with the latents as drawn, and the index of
    the observation as `latents["view"]`: leave latents out for views to be unknown.

    Args:
        items: (N, ...), what the projections take: volumes, images or maps.
        observations: Observations, or anything with a projection and a prior; they must draw the same latents.
        each: projections of an item.
        seed: the draws are a function of the seed.
        binary: threshold the projections at one half.
        chunk: projections made at once.

    Raises:
        UserError: if there is no observation, or observations draw different latents.
    """
    items = items if isinstance(items, Collection) else Collection(items)
    if not observations or each < 1:
        raise UserError("observe: give at least one observation, and at least one projection of each item")
    rows = torch.arange(len(items)).repeat_interleave(each)
    parts = [
        _projected(items.batch(some), observations, generator_at(seed, step, "render"))
        for step, some in enumerate(rows.split(chunk))
    ]
    _check_same({frozenset(latents) for _, latents in parts})
    images = torch.cat([image for image, _ in parts])
    latents = _joined([latents for _, latents in parts])
    names = [f"{name}#{k}" for name in items.names for k in range(each)]
    images = (images >= 0.5).float() if binary else images
    return Collection(images, names=names, latents=latents, source=f"{items.source}, rendered")


@torch.no_grad()
def _projected(x: Tensor, observations: Sequence[Observing], rng: torch.Generator) -> tuple[Tensor, dict[str, Tensor]]:
    """Projections of a batch and their latents.

    Latents are drawn by observation. Those that share a projection, as bins of azimuth do, are projected at once: a
    small batch takes hardly less time than a large one.
    """
    which = torch.randint(len(observations), (len(x),), generator=rng)
    groups: dict[int, list[tuple[int, Tensor, dict[str, Tensor]]]] = {}
    for k in which.unique().tolist():
        rows = (which == k).nonzero()[:, 0]
        theta = observations[k].prior.sample(len(rows), rng)
        groups.setdefault(id(observations[k].projection), []).append((k, rows, theta))
    _check_same({frozenset(theta) for group in groups.values() for _, _, theta in group})
    images, drawn, order = [], [], []
    for group in groups.values():
        rows = torch.cat([rows for _, rows, _ in group])
        theta = _joined([theta for _, _, theta in group])
        images.append(observations[group[0][0]].projection(x[rows], **theta))
        drawn.append(theta)
        order.append(rows)
    back = torch.cat(order).argsort()
    latents = {name: values[back] for name, values in _joined(drawn).items()}
    return torch.cat(images)[back], {**latents, "view": which.float()}


def _joined(drawn: Sequence[dict[str, Tensor]]) -> dict[str, Tensor]:
    return {name: torch.cat([theta[name] for theta in drawn]) for name in drawn[0]}


def _check_same(names: set[frozenset[str]]) -> None:
    if len(names) != 1:
        raise UserError("observe: the observations draw different latents; give them to observe one by one")
