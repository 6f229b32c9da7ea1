"""Coarse to fine: shapes of half the size are learned first, in the same way, by the same arguments."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from ..adversarial.regularisers import Rectilinear, Regulariser, Regularisers, Solid
from ..assignment import Panel, Predicted
from ..networks import MultiScaleDiscriminator, ViewPredictor
from ..networks.blocks import last_keeps_width, upsampling_levels
from ..training import Adam, Coarse, Recipe
from .sizes import SMALL

SHARE = 0.8
"""Of the budget for half the size, a step of which takes a quarter of the time. With less, chairs of photographs lost
their legs at full size (docs/trials.md, "How long the fine part may be")."""


def from_half_size(recipe: Recipe, function: Callable[..., Recipe], arguments: Mapping[str, Any]) -> Recipe:
    """Return a recipe of shapes with one of half the size before it, if it has at least twice the least size.

    It goes on where that ends: with one start, half the rate, preferences that have fallen, a discriminator that adds
    what is finer, and a view predictor of pictures of the least size, which is that of all sizes. As it was returned
    where networks cannot grow: with views direct, or if the last doubling of planes and lines loses channels.

    Args:
        recipe: of full size.
        function: the recipe function.
        arguments: that it was called with, those of fields of `Recipe` in `options`.
    """
    size = recipe.panels[0].shape[-1]
    if size < 2 * SMALL or arguments["views"] == "direct":
        return recipe
    if not last_keeps_width(arguments["channels"], upsampling_levels(size), arguments["rank"]):
        return recipe
    given = {**arguments, **arguments["options"], "size": size // 2}
    own = {name: value for name, value in given.items() if name not in ("options", "steps", "minutes")}
    discriminator = recipe.discriminator
    assert isinstance(discriminator, partial)
    settings = {name: discriminator.keywords[name] for name in ("channels", "shared", "bottleneck")}
    return recipe.replace(
        coarse=Coarse(partial(function, **own), SHARE),
        tries=None,
        generator_optimiser=_halved(recipe.generator_optimiser),
        discriminator_optimiser=_halved(recipe.discriminator_optimiser),
        regulariser=_fallen(recipe.regulariser),
        discriminator=partial(MultiScaleDiscriminator, coarsest=SMALL, **settings),
        panels=[_with_small_pictures(panel) for panel in recipe.panels],
    )


def _halved(adam: Adam) -> Adam:
    return replace(adam, rate=adam.rate / 2, final=None if adam.final is None else adam.final / 2)


def _fallen(regulariser: Regulariser | None) -> Regulariser | None:
    """Return preferences that begin where they ended, and fall as much again."""
    if isinstance(regulariser, Regularisers):
        return Regularisers(tuple(fallen for term in regulariser.terms if (fallen := _fallen(term))))
    if isinstance(regulariser, Solid | Rectilinear):
        return replace(regulariser, weight=regulariser.final, final=regulariser.final**2 / regulariser.weight)
    return regulariser


def _with_small_pictures(panel: Panel) -> Panel:
    """Return a panel whose view predictor, if it has one, sees pictures of the least size."""
    assignment = panel.assignment
    if not isinstance(assignment, Predicted):
        return panel
    fit = replace(assignment.fit, network=partial(ViewPredictor, most=SMALL))
    return replace(panel, assignment=replace(assignment, fit=fit))
