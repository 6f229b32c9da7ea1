"""Panel: the looks that share a projection and an image shape, judged by one discriminator, a head each."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from .._random import generator_at
from .._types import UserError
from ..adversarial.assignment import Known, Predicted, uniform_ways
from ..adversarial.learned_prior import LearnedPrior, WayDistribution, look_softly
from ..data.sampling import batch_rows
from ..projections.observation import Observation
from ..projections.priors import sample_each
from .recipe import Looks, Recipe


@dataclass
class Panel:
    """Real images, who made them (`ways`, which observation) and who judges them (`heads`), both (N,).

    With a learned prior nobody made them, and `distribution` says how often generated things are looked at in each way.
    """

    observations: tuple[Observation, ...]
    items: Tensor
    ways: Tensor
    heads: Tensor
    discriminator: nn.Module
    distribution: WayDistribution | None = None
    pull: float = 1.0

    @property
    def weight(self) -> float:
        return self.observations[0].weight

    @property
    def smoothing(self) -> float:
        return self.observations[0].smoothing

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

    def look_as_learned(self, x: Tensor, settings: LearnedPrior, rng: torch.Generator) -> Tensor:
        """y_b = P_i(x_b, θ_b), i drawn from the learned distribution, which gets a gradient from the first of them."""
        assert self.distribution is not None
        u = self.distribution.relaxed(len(x), settings.temperature, rng)
        if not torch.is_grad_enabled():
            return self.look(x, u.argmax(1).cpu(), rng)
        return look_softly(lambda things, way: self.look(things, way, rng), x, u, settings.images)


def build_panels(recipe: Recipe) -> list[Panel]:
    """Group the looks of a recipe by projection and image shape, in the order they are given."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for index, (observation, collection) in enumerate(recipe.looks):
        key = (_identity(observation.projection), tuple(collection.items.shape[1:]))
        groups.setdefault(key, []).append(index)
    for rows in groups.values():
        for what in ("weight", "smoothing"):
            if len({getattr(recipe.looks[i][0], what) for i in rows}) > 1:
                names = ", ".join(repr(recipe.looks[i][0].name) for i in rows)
                raise UserError(f"observations {names} share a projection and a discriminator: give them one {what}")
    panels = [_panel(recipe, [recipe.looks[i] for i in rows]) for rows in groups.values()]
    if not isinstance(recipe.assignment, Known) and (len(panels) != 1 or len(recipe.looks) < 2):
        kind = type(recipe.assignment).__name__
        raise UserError(f"{kind} assignment: give at least two looks that share one projection and one collection")
    return panels


def _identity(projection: object) -> object:
    """Equal frozen projections are one; others are told apart by identity."""
    return projection if type(projection).__hash__ is not object.__hash__ else id(projection)


def _panel(recipe: Recipe, looks: Looks) -> Panel:
    observations = tuple(observation for observation, _ in looks)
    if not isinstance(recipe.assignment, Known):
        return _unassigned_panel(recipe, looks, observations)
    items = torch.cat([collection.floats() for _, collection in looks])
    ways = torch.cat([torch.full((len(collection),), way) for way, (_, collection) in enumerate(looks)])
    return Panel(observations, items, ways, ways.clone(), recipe.discriminator(tuple(items.shape[1:]), len(looks)))


def _unassigned_panel(recipe: Recipe, looks: Looks, observations: tuple[Observation, ...]) -> Panel:
    collection, assignment = looks[0][1], recipe.assignment
    if any(other is not collection for _, other in looks):
        kind = type(assignment).__name__
        raise UserError(f"{kind} assignment: every observation must stand beside the same collection")
    ways = uniform_ways(len(collection), len(looks), recipe.seed)
    heads = 1 if not isinstance(assignment, Predicted) else assignment.clusters or len(looks)
    discriminator = recipe.discriminator(tuple(collection.items.shape[1:]), heads)
    distribution = WayDistribution(len(looks)) if isinstance(assignment, LearnedPrior) else None
    return Panel(observations, collection.floats(), ways, torch.zeros_like(ways), discriminator, distribution)


def panel_rng(seed: int, draw: int, panel: int, rank: int) -> torch.Generator:
    """The generator of the latents drawn by one panel at one update."""
    return generator_at(seed, draw, f"latents/{panel}/{rank}")
