"""An observation draws exactly what its projection takes, a draw for each element."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from unproject._random import generator_at
from unproject._types import UserError
from unproject.projections.base import Identity, Projection
from unproject.projections.observation import Observation
from unproject.projections.priors import Product, Uniform


class Shift(Projection):
    def forward(self, x: Tensor, *, by: Tensor, scale: Tensor | None = None) -> Tensor:
        return x + by.view(-1, 1) * (1 if scale is None else scale.view(-1, 1))


BOTH = Product(Uniform("scale", 1, 2), Uniform("by", 0, 1))


def test_latents_are_the_keyword_only_parameters() -> None:
    assert Shift().latents == ("by", "scale") and Identity().latents == ()


@pytest.mark.parametrize("prior", [Uniform("by", 0, 1), Product(), Product(BOTH, Uniform("tilt", 0, 1))], ids=str)
def test_a_prior_that_draws_something_else_is_refused(prior: Uniform | Product) -> None:
    drawn = sorted(prior.names)
    with pytest.raises(UserError) as caught:
        Observation("moved", Shift(), prior)
    message = f"observation 'moved': Shift takes the latents ['by', 'scale'] but the prior draws {drawn}"
    assert str(caught.value).startswith(message)


def test_a_projection_without_forward_is_refused() -> None:
    class Missing(Projection):
        pass

    for use in (lambda: Missing()(torch.zeros(2, 1)), lambda: Missing().latents, lambda: Observation("m", Missing())):
        with pytest.raises(UserError, match="Missing defines no forward: add `def forward"):
            use()


def test_a_misspelt_latent_is_pythons_own_error() -> None:
    with pytest.raises(TypeError, match="unexpected keyword argument 'bye'"):
        Shift()(torch.zeros(2, 1), bye=torch.zeros(2))


def test_each_element_has_its_own_draw() -> None:
    observation = Observation("moved", Shift(), BOTH)
    y = observation(torch.zeros(50, 3, dtype=torch.float64), generator_at(0))
    theta = BOTH.sample(50, generator_at(0))
    assert y.dtype == torch.float64 and len(y[:, 0].unique()) == 50
    torch.testing.assert_close(y[:, 0].float(), theta["by"] * theta["scale"])
    assert torch.equal(y, observation(torch.zeros(50, 3, dtype=torch.float64), generator_at(0)))


def test_the_identity_is_seen_without_latents() -> None:
    x = torch.rand(2, 4, 4, 4)
    assert Observation("volume", Identity(), Product())(x, generator_at(0)) is x
