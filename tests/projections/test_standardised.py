"""Standardised projections: what they do to the mean, what they leave alone, and the way back."""

from __future__ import annotations

import pytest
import torch

from unproject._random import generator_at
from unproject._types import UserError
from unproject.projections.base import Identity
from unproject.projections.observation import Observation
from unproject.projections.rendering import Rendering, rendering_prior
from unproject.projections.selection import Selection
from unproject.projections.standardised import Standardised, standardised
from unproject.testing import check_projection


def test_real_images_get_one_mean_and_deviation() -> None:
    images = torch.rand(50, 3, 8, 8, generator=generator_at(0)) * torch.tensor([0.01, 1.0, 5.0])[:, None, None] + 0.04
    projection = standardised(Identity(), images)
    brought = projection.standardise(images)
    torch.testing.assert_close(brought.mean((0, 2, 3)), torch.full((3,), 0.5), atol=0.02, rtol=0)
    torch.testing.assert_close(brought.std((0, 2, 3)), torch.full((3,), 0.25), atol=0.01, rtol=0)
    torch.testing.assert_close(projection.restore(brought), images, atol=1e-5, rtol=0)


def test_what_does_not_vary_is_not_blown_up() -> None:
    assert standardised(Identity(), torch.full((5, 1, 4, 4), 0.3)).deviation == (1e-3,)


def test_the_laws_hold_through_it() -> None:
    x = 0.2 + 0.5 * torch.rand(3, 8, 4, 4, generator=generator_at(1))
    check_projection(Standardised(Selection("diffuse"), (0.5,) * 3, (0.1, 0.2, 0.3)), x)
    projection = Rendering("directional")
    brought = Standardised(projection, (0.5,) * 3, (0.2,) * 3)
    assert brought.latents == projection.latents
    check_projection(Observation("lamp", brought, rendering_prior(projection, 0.3)), x)


@pytest.mark.parametrize("mean, deviation", [((), ()), ((0.5,), (0.1, 0.1)), ((0.5,), (0.0,))])
def test_a_deviation_that_cannot_be_is_refused(mean: tuple[float, ...], deviation: tuple[float, ...]) -> None:
    with pytest.raises(UserError, match="deviation"):
        Standardised(Identity(), mean, deviation)
