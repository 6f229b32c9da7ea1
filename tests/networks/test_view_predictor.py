"""The view predictor: the discriminator's convolutions with batch norm, and a logit a bin."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from unproject._types import UserError
from unproject.networks import Discriminator, ViewPredictor


@pytest.mark.parametrize("shape", [(1, 16, 16), (1, 64, 64), (3, 32, 48), (1, 32), (2, 48)])
def test_a_logit_a_bin(shape: tuple[int, ...]) -> None:
    assert ViewPredictor(shape, bins=5, channels=4)(torch.rand(3, *shape)).shape == (3, 5)


def test_batch_norm_follows_each_of_four_convolutions() -> None:
    layers = list(ViewPredictor((1, 32, 32), 16).layers)
    block = [nn.Conv2d, nn.BatchNorm2d, nn.LeakyReLU]
    assert [type(layer) for layer in layers] == [*block * 4, nn.Flatten, nn.Linear]


def test_it_has_the_discriminators_convolutions() -> None:
    def geometry(model: nn.Module) -> list[tuple[object, ...]]:
        found = [m for m in model.modules() if isinstance(m, nn.Conv2d)]
        return [(m.in_channels, m.out_channels, m.kernel_size, m.stride, m.padding) for m in found]

    discriminator = Discriminator((1, 32, 32), heads=16, channels=8, shared=4)
    assert geometry(ViewPredictor((1, 32, 32), 16, channels=8)) == geometry(discriminator)


def test_images_are_scaled_to_minus_one_and_one() -> None:
    model, seen = ViewPredictor((1, 16, 16), 4, channels=4), []
    model.layers[0].register_forward_hook(lambda module, x, y: seen.append(x[0]))
    model(torch.stack([torch.zeros(1, 16, 16), torch.ones(1, 16, 16)]))
    assert (seen[0][0] == -1).all() and (seen[0][1] == 1).all()


def test_images_are_scored_alone_in_evaluation_only() -> None:
    model, image = ViewPredictor((1, 16, 16), 4, channels=4), torch.rand(6, 1, 16, 16)
    assert not torch.allclose(model(image)[:2], model(image[:2]), atol=1e-3)
    model.eval()
    torch.testing.assert_close(model(image)[:2], model(image[:2]))


@pytest.mark.parametrize("shape", [(1, 8, 32), (1, 15)])
def test_images_that_are_too_small_are_refused(shape: tuple[int, ...]) -> None:
    with pytest.raises(UserError, match="at least 16 a side"):
        ViewPredictor(shape, bins=5)
