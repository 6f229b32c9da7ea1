"""A tiny VP-MP-GAN finds views: shapes like an L from eight unknown views, in 120 steps."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import torch
from torch import Tensor

from unproject._random import generator_at
from unproject.adversarial.penalties import R1R2
from unproject.adversarial.regularisers import Solid
from unproject.assignment import Panel, PredictorFit
from unproject.data import Collection, observe
from unproject.networks import Discriminator, LowRankGenerator, ViewPredictor
from unproject.projections.silhouette import Silhouette, azimuth_bins
from unproject.recipes.pairing import frequent_rounds
from unproject.training import Adam, Recipe, train

SIZE, BINS = 16, 8


def boots(count: int) -> Tensor:
    """Volumes (count, 16, 16, 16): a low bar along z of varied sides with a block on its back end."""
    rng = generator_at(3)
    volumes = torch.zeros(count, SIZE, SIZE, SIZE)
    for volume in volumes:
        length, height, width = (int(torch.randint(a, b, (), generator=rng)) for a, b in ((12, 15), (4, 7), (3, 5)))
        across, back = slice(7 - width // 2, 9 + width // 2), SIZE // 2 - length // 2
        volume[across, 2 : 2 + height, back : SIZE // 2 + length // 2] = 1
        volume[across, 2 : 7 + height, back : back + 4] = 1
    return volumes


def test_views_are_found_far_above_chance(tmp_path: Path) -> None:
    """0.47, 0.50, 0.50 exact on seeds 0, 1, 2, chance 0.15. A predictor fitted to shuffled labels stays at chance."""
    torch.set_num_threads(1)
    views = azimuth_bins(BINS, Silhouette(size=SIZE, rule="absorption", density=2.0))
    silhouettes = observe(Collection(boots(150)), views, 4, 1)
    fit = PredictorFit(partial(ViewPredictor, channels=8), images=512, steps=25, batch=64)
    adam = Adam(2e-3, final=2e-4)
    recipe = Recipe(
        partial(LowRankGenerator, size=SIZE, channels=32, rank=8, code_size=16, mirror=True),
        [Panel(views, silhouettes, replace(frequent_rounds(12, 0.8), fit=fit))],
        discriminator=partial(Discriminator, channels=16, shared=4, bottleneck=64, common=True),
        penalty=R1R2(0.1, every=8),
        regulariser=Solid(0.1, 0.01),
        generator_optimiser=adam,
        discriminator_optimiser=adam,
        batch=32,
        views_per_sample=4,
        steps=120,
    )
    scores = train(recipe, tmp_path, quiet=True).evaluate(n=16)
    assert scores["view_chance_exact"].value < 0.2
    assert scores["view_exact"].value > 0.35 and scores["view_within_one"].value > 0.55
    assert scores["view_information"].value > 1.0
