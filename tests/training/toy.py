"""A toy recipe: everything the real ones do, at a size at which a step takes milliseconds.

Usable from the command line too: `unproject train tests/training/toy.py:toy --steps 4 --out DIR`.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Literal

import torch
from torch import Tensor, nn

from unproject.adversarial.assignment import Known, Predicted
from unproject.adversarial.learned_prior import LearnedPrior
from unproject.adversarial.losses import Hinge, Loss, Relativistic, Wasserstein
from unproject.adversarial.penalties import R1R2, GradientPenalty, Penalty
from unproject.data import Collection, chairs, observe
from unproject.networks import Discriminator, Generator, LowRankGenerator, ViewPredictor
from unproject.projections.base import Identity
from unproject.projections.observation import Observation
from unproject.projections.priors import Product
from unproject.projections.silhouette import Silhouette, azimuth_bins, continuous_views
from unproject.recipes.pairing import Views, by_known_view
from unproject.recipes.shapes import look_at
from unproject.training import Adam, Recipe
from unproject.training.recipe import Looks

SIZE, CHAIRS, BINS = 16, 24, 4


class Layer(Generator):
    """The smallest generator there is, and one from outside the package."""

    def __init__(self, code_size: int = 4) -> None:
        super().__init__(code_size)
        self.linear = nn.Linear(code_size, SIZE**3)

    def forward(self, code: Tensor) -> Tensor:
        return torch.sigmoid(self.linear(code)).view(-1, SIZE, SIZE, SIZE)


def toy(
    *,
    data: Path | None = None,
    views: Views = "predicted",
    steps: int | None = None,
    minutes: float | None = None,
    seed: int = 0,
    batch: int = 4,
    rate: float = 5e-4,
    loss: Literal["relativistic", "wasserstein", "hinge"] = "relativistic",
    starts: tuple[float, ...] = (0.25, 0.5, 0.75),
    images: int = 64,
    clusters: int | None = None,
    restart: bool = False,
    draw: Literal["argmax", "posterior"] = "argmax",
    discriminator_steps: int = 1,
    looks_each: int = 1,
    precision: Literal["float32", "bfloat16"] = "float32",
    compile: bool = False,
    checkpoint_every: int = 100,
) -> Recipe:
    """Chairs of 16³ voxels from silhouettes of four views."""
    silhouette = Silhouette(size=SIZE, rule="absorption", density=2.0)
    predicted = Predicted(
        partial(ViewPredictor, channels=4),
        starts,
        images,
        steps=5,
        batch=16,
        clusters=clusters,
        restart=restart,
        draw=draw,
    )
    of_loss: dict[str, tuple[Loss, Penalty | None]] = {
        "relativistic": (Relativistic(), R1R2(1.0, every=4)),
        "wasserstein": (Wasserstein(), GradientPenalty(10.0)),
        "hinge": (Hinge(), None),
    }
    adam = Adam(rate)
    return Recipe(
        generator=partial(LowRankGenerator, size=SIZE, channels=8, rank=4, code_size=8),
        discriminator=partial(Discriminator, channels=4, bottleneck=16, shared=4, volumetric=views == "direct"),
        looks=look_at(data, views, azimuth_bins(BINS, silhouette), 2, False, seed)
        if data
        else toy_looks(views, silhouette, seed),
        assignment={"predicted": predicted, "learned": LearnedPrior(images=2)}.get(views, Known()),
        loss=of_loss[loss][0],
        penalty=of_loss[loss][1],
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        discriminator_steps=discriminator_steps,
        batch=batch,
        looks_each=looks_each,
        steps=12 if steps is None and minutes is None else steps,
        minutes=minutes,
        seed=seed,
        precision=precision,
        compile=compile,
        checkpoint_every=checkpoint_every,
    )


def own(*, steps: int = 2, seed: int = 0) -> Recipe:
    """A recipe with a generator of its own."""
    return toy(steps=steps, seed=seed, views="known").replace(generator=Layer)


def toy_looks(views: Views, silhouette: Silhouette, seed: int) -> Looks:
    """The looks of the shape recipes on a few chairs, since theirs are a thousand."""
    shapes = Collection(chairs(CHAIRS, SIZE))
    if views == "direct":
        return [(Observation("volume", Identity(), Product()), shapes)]
    ways = azimuth_bins(BINS, silhouette)
    seen = observe(shapes, ways, 2, seed)
    if views == "known":
        return by_known_view(seen, ways)
    return [(way, seen) for way in (ways if views in ("predicted", "learned") else continuous_views(silhouette))]
