"""FramedSilhouette: neither the size nor the place of an object is in its picture."""

from __future__ import annotations

import math

import pytest
import torch

import unproject as up
from unproject import UserError
from unproject._random import generator_at
from unproject.data import chairs
from unproject.projections import FramedSilhouette, Silhouette
from unproject.testing import apply_laws
from unproject.testing.projections import PROJECTION_LAWS, projection_case

SIDE = 32


@pytest.mark.parametrize("rule", ["any", "absorption"])
def test_all_laws_hold_but_that_of_the_gradient(rule: str) -> None:
    """Where the object is in the picture is a constant for gradients."""
    prior = up.Product(up.Uniform("azimuth", 0, 6.28), up.Uniform("elevation", -0.5, 0.5))
    part = up.Observation("look", FramedSilhouette(Silhouette(size=6, rule=rule)), prior)  # type: ignore[arg-type]
    few = torch.rand(2, 5, 5, 5, generator=generator_at(0)) ** 3  # where gradcheck fails it is slow
    results = apply_laws(PROJECTION_LAWS, projection_case(part, few, 0))
    assert {result.name for result in results if not result.passed} <= {"differentiable", "latents"}


def test_size_and_place_are_forgotten() -> None:
    x = torch.zeros(2, SIDE, SIDE, SIDE)
    x[0, 8:24, 4:28, 12:20], x[1, 2:10, 1:13, 3:7] = 1, 1
    for azimuth in (0.0, math.pi / 2, 1.0):
        y = FramedSilhouette(Silhouette(size=SIDE))(x, azimuth=torch.full((2,), azimuth))
        assert (y[0] - y[1]).abs().mean() < 0.03


def test_pictures_are_framed_as_projections_are() -> None:
    silhouette, azimuth = Silhouette(size=SIDE), torch.tensor([0.4, 2.0, 5.0])
    look = FramedSilhouette(silhouette, 0.7)
    torch.testing.assert_close(
        look(chairs(3, SIDE), azimuth=azimuth), look.prepare(silhouette(chairs(3, SIDE), azimuth=azimuth))
    )


@pytest.mark.parametrize(
    "wrong", [{"silhouette": Silhouette()}, {"fill": 0.0}, {"fill": 1.5}], ids=["no size", "nothing", "too much"]
)
def test_settings_out_of_range_are_refused(wrong: dict) -> None:
    with pytest.raises(UserError, match="give the silhouette a size"):
        FramedSilhouette(**{"silhouette": Silhouette(size=8), **wrong})
