"""A toy recipe: everything the real ones do, at a size at which a step takes milliseconds.

Usable from the command line too: `unproject train tests/training/toy.py:toy --steps 4 --out DIR`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor, nn
from typing_extensions import Unpack

from unproject.adversarial.losses import Hinge, Loss, Relativistic, Wasserstein
from unproject.adversarial.penalties import R1R2, GradientPenalty, Penalty
from unproject.assignment import Estimator, JointlyPredicted, Panel, Predicted, PredictorFit, Rounds
from unproject.data import Collection, chairs, observe
from unproject.networks import Discriminator, Generator, LowRankGenerator, ViewPredictor
from unproject.projections.observation import Observation
from unproject.projections.silhouette import Silhouette, azimuth_bins, mirrored_views
from unproject.recipes.pairing import Views, panel_of
from unproject.recipes.shapes import silhouettes_of
from unproject.training import Adam, Options, Recipe, resumable

SIZE, CHAIRS, BINS = 16, 24, 4


class Layer(Generator):
    """The smallest generator there is, and one from outside the package."""

    domain = "volumes"

    def __init__(self, code_size: int = 4) -> None:
        super().__init__(code_size)
        self.linear = nn.Linear(code_size, SIZE**3)

    def forward(self, code: Tensor) -> Tensor:
        return torch.sigmoid(self.linear(code)).view(-1, SIZE, SIZE, SIZE)


@resumable
def toy(
    *,
    data: Path | None = None,
    views: Views = "predicted",
    seed: int = 0,
    rate: float = 5e-4,
    loss: Literal["relativistic", "wasserstein", "hinge"] = "relativistic",
    starts: tuple[float, ...] = (0.25, 0.5, 0.75),
    images: int = 64,
    clusters: int | None = None,
    restart: bool = False,
    draw: Literal["argmax", "posterior"] = "argmax",
    **options: Unpack[Options],
) -> Recipe:
    """Chairs of 16³ voxels from silhouettes of four views."""
    silhouette = Silhouette(size=SIZE, rule="absorption", density=2.0)
    predicted = Predicted(
        Rounds(starts, restart=restart),
        PredictorFit(partial(ViewPredictor, channels=4), images, steps=5, batch=16),
        Estimator(draw, clusters=clusters),
    )
    of_loss: dict[str, tuple[Loss, Penalty | None]] = {
        "relativistic": (Relativistic(), R1R2(1.0, every=4)),
        "wasserstein": (Wasserstein(), GradientPenalty(10.0)),
        "hinge": (Hinge(), None),
    }
    adam = Adam(rate)
    observations = azimuth_bins(BINS, silhouette)
    return Recipe(
        generator=partial(LowRankGenerator, size=SIZE, channels=8, rank=4, code_size=8),
        discriminator=partial(Discriminator, channels=4, bottleneck=16, shared=4, volumetric=views == "direct"),
        panels=[panel_of(views, observations, toy_data(data, views, observations, seed), predicted)],
        loss=of_loss[loss][0],
        penalty=of_loss[loss][1],
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        batch=4,
        steps=12,
        checkpoint_every=100,
        seed=seed,
    ).configured(options)


def own(*, steps: int = 2, seed: int = 0) -> Recipe:
    """A recipe with a generator of its own."""
    return toy(steps=steps, seed=seed, views="known").replace(generator=Layer)


def toy_data(data: Path | None, views: Views, observations: tuple[Observation, ...], seed: int) -> Collection:
    """The data of the shape recipes with few chairs, since theirs are a thousand."""
    if data is not None:
        return silhouettes_of(data, views, observations, 2, False, seed)
    shapes = Collection(chairs(CHAIRS, SIZE))
    return shapes if views == "direct" else observe(shapes, observations, 2, seed)


def with_panel(recipe: Recipe, **changes: Any) -> Recipe:
    """The recipe with its first panel changed."""
    first, *others = recipe.panels
    return recipe.replace(panels=[replace(first, **changes), *others])


def with_predicted(recipe: Recipe, **changes: Any) -> Recipe:
    """The recipe with its first panel's assignment changed; `fit`, `rounds`, `estimator` as dictionaries of fields."""
    assignment = recipe.panels[0].assignment
    assert isinstance(assignment, Predicted)
    whole = {
        name: replace(getattr(assignment, name), **change) if isinstance(change, dict) else change
        for name, change in changes.items()
    }
    return with_panel(recipe, assignment=replace(assignment, **whole))


def jointly(recipe: Recipe, **settings: Any) -> Recipe:
    """The recipe with a predictor that is trained along with the generator, and sees mirror images."""
    assignment = recipe.panels[0].assignment
    assert isinstance(assignment, Predicted)
    fit = replace(assignment.fit, mirrored=mirrored_views(BINS))
    made = JointlyPredicted(assignment.rounds, fit, assignment.estimator, **settings)
    return with_panel(recipe, assignment=made)


def only_panel(recipe: Recipe) -> Panel:
    (panel,) = recipe.panels
    return panel
