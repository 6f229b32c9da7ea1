"""The deviations that docs/reproduction.md states are those of the code."""

from __future__ import annotations

from functools import partial

import pytest
from torch import nn

from unproject.assignment import Predicted
from unproject.networks import DCGANDiscriminator, Discriminator
from unproject.networks.materials import LEAST_ROUGHNESS
from unproject.ops.shading import Sampling
from unproject.projections.rendering import Rendering
from unproject.projections.standardised import MIDDLE, SCALE
from unproject.recipes import find
from unproject.reproduce.deviations import PAPER_DIGITS, PAPER_MATERIALS, PAPER_RECIPES, PAPER_SHAPES, SECTIONS


def stated(lines: tuple[str, ...], *words: str) -> bool:
    return any(all(word in line for word in words) for line in lines)


def test_the_deviations_of_materials() -> None:
    first, second, third = list(DCGANDiscriminator((3, 64, 64)).layers)[:3]
    assert isinstance(first, nn.Conv2d) and isinstance(second, nn.LeakyReLU) and isinstance(third, nn.Conv2d)
    assert stated(PAPER_MATERIALS, "No batch norm after the first convolution")
    assert (MIDDLE, SCALE) == (0.5, 0.25) and stated(PAPER_MATERIALS, "mean 0.5 and deviation 0.25")
    assert Sampling().light == 3 / 8 and stated(PAPER_MATERIALS, "three eighths of the samples")
    assert Rendering().space == "texture" and stated(PAPER_MATERIALS, "Grazing views in texture space")
    assert LEAST_ROUGHNESS == 0.005 and stated(PAPER_MATERIALS, "0.005 is added")


def test_the_deviations_of_shapes_and_digits() -> None:
    shapes = find("shapes-paper")(size=16, views_per_shape=1, steps=1)
    assignment = shapes.panels[0].assignment
    assert isinstance(assignment, Predicted)
    predictor = assignment.fit.network
    assert isinstance(predictor, partial) and predictor.keywords == {"channels": 32}
    assert stated(PAPER_SHAPES, "32 channels") and stated(PAPER_DIGITS, "32 channels")
    assert isinstance(Discriminator((1, 16, 16)).last, nn.Embedding) and stated(PAPER_SHAPES, "without a sigmoid")
    assert assignment.fit.steps == 100_000 and assignment.fit.images == 65_536
    assert stated(PAPER_SHAPES, "100,000 steps on 65,536")
    assert stated(PAPER_RECIPES, "moving average", "half-life of 300", "--ema-half-life 0", "does not mention")


@pytest.mark.parametrize("binary", [True, False])
def test_training_silhouettes_are_soft_unless_asked_for(binary: bool) -> None:
    flags = {"binary": True} if binary else {}
    images = find("shapes-paper")(size=16, views_per_shape=1, steps=1, **flags).panels[0].collections[0].floats()
    assert bool(((images == 0) | (images == 1)).all()) == binary
    assert stated(PAPER_SHAPES, "Soft silhouettes", "unless --binary is given")


def test_no_deviation_is_stated_twice() -> None:
    lines = [line for lines in SECTIONS.values() for line in lines]
    assert len(set(lines)) == len(lines)
