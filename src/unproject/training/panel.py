"""Panel: the looks that share a projection and an image shape, judged by one discriminator, a head each."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from .._random import generator_at
from .._types import UserError
from ..adversarial.assignment import Predicted, uniform_ways
from ..data.sampling import batch_rows
from ..projections.observation import Observation
from ..projections.priors import sample_each
from .recipe import Looks, Recipe


@dataclass
class Panel:
    """Real images, who made them (`ways`, which observation) and who judges them (`heads`), both (N,)."""

    observations: tuple[Observation, ...]
    items: Tensor
    ways: Tensor
    heads: Tensor
    discriminator: nn.Module

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(self.items.shape[1:])

    def rows(self, batch: int, seed: int, draw: int, rank: int, world: int) -> Tensor:
        """The rows of the `draw`-th batch of real images."""
        return batch_rows(len(self.items), batch, seed, draw, rank, world)

    def look(self, x: Tensor, way: Tensor, rng: torch.Generator) -> Tensor:
        """y_b = P_i(x_b, θ_b), i = way[b], θ_b ~ p_i, in one call of the shared projection."""
        theta = sample_each([o.prior for o in self.observations], way, rng) if self.observations[0].prior.names else {}
        return self.observations[0].projection(x, **{name: value.to(x) for name, value in theta.items()})


def build_panels(recipe: Recipe) -> list[Panel]:
    """Group the looks of a recipe by projection and image shape, in the order they are given."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for index, (observation, collection) in enumerate(recipe.looks):
        key = (_identity(observation.projection), tuple(collection.items.shape[1:]))
        groups.setdefault(key, []).append(index)
    panels = [_panel(recipe, [recipe.looks[i] for i in rows]) for rows in groups.values()]
    if isinstance(recipe.assignment, Predicted) and (len(panels) != 1 or len(recipe.looks) < 2):
        raise UserError("Predicted assignment: give at least two looks that share one projection and one collection")
    return panels


def _identity(projection: object) -> object:
    """Equal frozen projections are one; others are told apart by identity."""
    return projection if type(projection).__hash__ is not object.__hash__ else id(projection)


def _panel(recipe: Recipe, looks: Looks) -> Panel:
    observations = tuple(observation for observation, _ in looks)
    if isinstance(recipe.assignment, Predicted):
        return _unassigned_panel(recipe, looks, observations)
    items = torch.cat([collection.items for _, collection in looks])
    ways = torch.cat([torch.full((len(collection),), way) for way, (_, collection) in enumerate(looks)])
    return Panel(observations, items, ways, ways.clone(), recipe.discriminator(tuple(items.shape[1:]), len(looks)))


def _unassigned_panel(recipe: Recipe, looks: Looks, observations: tuple[Observation, ...]) -> Panel:
    assert isinstance(recipe.assignment, Predicted)
    collection = looks[0][1]
    if any(other is not collection for _, other in looks):
        raise UserError("Predicted assignment: every observation must stand beside the same collection")
    ways = uniform_ways(len(collection), len(looks), recipe.seed)
    heads = recipe.assignment.clusters or len(looks)
    discriminator = recipe.discriminator(tuple(collection.items.shape[1:]), heads)
    return Panel(observations, collection.items, ways, torch.zeros_like(ways), discriminator)


def panel_rng(seed: int, draw: int, panel: int, rank: int) -> torch.Generator:
    """The generator of the latents drawn by one panel at one update."""
    return generator_at(seed, draw, f"latents/{panel}/{rank}")
