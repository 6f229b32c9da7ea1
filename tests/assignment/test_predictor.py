"""The view predictor: classes that can be separated are learned, a fit is a function of the seed, rounds are due."""

from __future__ import annotations

from functools import partial
from typing import Any

import pytest
import torch
from torch import Tensor, nn
from torch.optim.optimizer import register_optimizer_step_pre_hook

from unproject._random import generator_at, seeded
from unproject._types import UserError
from unproject.assignment import PredictorFit, Rounds
from unproject.networks import ViewPredictor
from unproject.projections.silhouette import mirrored_views

SMALL = partial(ViewPredictor, channels=4)


def quadrants(n: int = 256) -> tuple[Tensor, Tensor]:
    """Noisy images with one bright quadrant, and which."""
    way = torch.randint(4, (n,), generator=generator_at(0, 0, "ways"))
    images = 0.3 * torch.rand(n, 1, 16, 16, generator=generator_at(0, 0, "noise"))
    for i, w in enumerate(way.tolist()):
        images[i, 0, 8 * (w // 2) :, 8 * (w % 2) :][:8, :8] += 0.6
    return images, way


def trained(fit: PredictorFit, images: Tensor, views: Tensor) -> tuple[nn.Module, float]:
    with seeded(0, "predictor"):
        predictor = fit.network((1, 16, 16), 4)
    return predictor, fit.fitted(predictor, images, views, seed=0)


def test_separable_classes_are_learned_at_once() -> None:
    images, views = quadrants()
    predictor, loss = trained(PredictorFit(SMALL, steps=40, batch=32), images, views)
    assert not predictor.training and loss < 0.4
    assert (predict(predictor, images).argmax(1) == views).float().mean() > 0.97


def test_shuffled_labels_are_not_learned() -> None:
    images, views = quadrants()
    _, loss = trained(PredictorFit(SMALL, steps=40, batch=32), images, views.flip(0))
    assert loss > 0.8


def test_training_is_a_function_of_the_seed() -> None:
    images, views = quadrants()
    fit = PredictorFit(SMALL, steps=25, batch=16)
    first, loss = trained(fit, images, views)
    torch.manual_seed(99)
    second, again = trained(fit, images, views)
    assert loss == again
    assert all(torch.equal(a, b) for a, b in zip(first.state_dict().values(), second.state_dict().values()))


def test_a_fit_with_dropout_is_a_function_of_the_seed_and_gives_the_users_random_state_back() -> None:
    images, views = quadrants()

    def network(shape: tuple[int, ...], count: int) -> nn.Module:
        return nn.Sequential(nn.Flatten(), nn.Dropout(0.5), nn.Linear(256, count))

    found = []
    for _ in range(2):
        torch.rand(3)
        before = torch.random.get_rng_state()
        found.append(trained(PredictorFit(network, steps=5, batch=32), images, views)[1])
        assert torch.equal(before, torch.random.get_rng_state())
    assert found[0] == found[1]


def test_each_step_of_a_fit_drops_others() -> None:
    seen: list[Tensor] = []

    class Noted(nn.Linear):
        def forward(self, input: Tensor) -> Tensor:
            seen.append(torch.rand(2))
            return super().forward(input.flatten(1))

    images, views = quadrants()
    trained(PredictorFit(lambda shape, count: Noted(256, count), steps=2, batch=4), images, views)
    assert len(seen) == 2 and not torch.equal(*seen)


def test_the_learning_rate_falls_to_zero() -> None:
    rates: list[float] = []
    watch = register_optimizer_step_pre_hook(lambda adam, *_: rates.append(adam.param_groups[0]["lr"]))
    try:
        trained(PredictorFit(SMALL, steps=4, batch=8, learning_rate=1.0), *quadrants(8))
    finally:
        watch.remove()
    assert rates == [1.0, 0.75, 0.5, 0.25]


class Spy(ViewPredictor):
    def __init__(self, shape: tuple[int, ...], bins: int) -> None:
        super().__init__(shape, bins, channels=2)
        self.seen: list[Tensor] = []

    def forward(self, image: Tensor) -> Tensor:
        self.seen.append(image.detach())
        return super().forward(image)


def predict(predictor: nn.Module, images: Tensor, batch: int = 512) -> Tensor:
    return PredictorFit(SMALL).probabilities(predictor, images.split(batch))


@pytest.mark.parametrize("binarise", [True, False])
def test_projections_are_binarised_if_asked(binarise: bool) -> None:
    predictor, _ = trained(PredictorFit(Spy, steps=3, batch=16, binarise=binarise), *quadrants())
    assert isinstance(predictor, Spy) and predictor.seen[0].shape == (16, 1, 16, 16)
    assert (set(torch.cat(predictor.seen).unique().tolist()) == {0.0, 1.0}) == binarise


def test_prediction_by_chunks_is_prediction() -> None:
    predictor, images = Spy((1, 16, 16), 4).eval(), quadrants(10)[0]
    whole, parts = predict(predictor, images), predict(predictor, images, batch=3)
    assert [len(seen) for seen in predictor.seen] == [10, 3, 3, 3, 1]
    torch.testing.assert_close(whole, parts)
    torch.testing.assert_close(whole.sum(1), torch.ones(10))
    assert not whole.requires_grad


# Mirror images

EIGHT = mirrored_views(8)


def test_a_flipped_image_has_the_mirrored_probabilities() -> None:
    predictor, images = SMALL((1, 16, 16), 8).eval(), torch.rand(12, 1, 16, 16, generator=generator_at(0))
    fit = PredictorFit(SMALL, mirrored=EIGHT)
    p, flipped = (fit.probabilities(predictor, [y]) for y in (images, images.flip(-1)))
    torch.testing.assert_close(flipped[:, list(EIGHT)], p)
    torch.testing.assert_close(p.sum(1), torch.ones(12))
    alone = predict(predictor, images)
    assert (p - alone).abs().max() > 1e-4
    torch.testing.assert_close(p, (alone + predict(predictor, images.flip(-1))[:, list(EIGHT)]) / 2)


def test_half_of_the_images_are_flipped_with_their_labels() -> None:
    images, views = torch.rand(6, 1, 4, 4, generator=generator_at(0)), torch.tensor([0, 1, 2, 1, 4, 7])
    seen, labels = PredictorFit(SMALL, mirrored=EIGHT).half_mirrored(images, views)
    assert torch.equal(seen, torch.cat([images[:3], images[3:].flip(-1)]))
    assert labels.tolist() == [0, 1, 2, 7, 4, 1]
    plain = PredictorFit(SMALL).half_mirrored(images, views)
    assert torch.equal(plain[0], images) and torch.equal(plain[1], views)


def test_a_fit_learns_from_flipped_images_too() -> None:
    """The images of half of the views are left out; those of the mirrored views are all that tells them apart."""
    images, ways = quadrants()
    fit = PredictorFit(SMALL, steps=40, batch=32, mirrored=(1, 0, 3, 2))
    left = ways % 2 == 0
    predictor, _ = trained(fit, images[left], ways[left])
    assert (fit.probabilities(predictor, [images]).argmax(1) == ways).float().mean() > 0.97


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"starts": (0.5, 0.2)}, "increasing"),
        ({"starts": (0.2, 0.2)}, "increasing"),
        ({"starts": (0.0, 0.5)}, "between 0 and 1"),
        ({"starts": (0.5, 1.0)}, "between 0 and 1"),
    ],
    ids=str,
)
def test_wrong_rounds_are_refused(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        Rounds(**wrong)


@pytest.mark.parametrize("name", ["steps", "images", "batch"])
def test_fits_of_nothing_are_refused(name: str) -> None:
    with pytest.raises(UserError, match=f"{name}=0"):
        PredictorFit(SMALL, **{name: 0})  # type: ignore[arg-type]


@pytest.mark.parametrize("starts", [(), (0.5,), (0.1, 0.2, 0.9)])
def test_rounds_are_due_from_their_starts_on(starts: tuple[float, ...]) -> None:
    rounds = Rounds(starts)
    assert rounds.due(0.0) == 0 and rounds.due(1.0) == len(starts)
    assert rounds.due(0.5) == sum(start <= 0.5 for start in starts)


def test_probabilities_are_of_each_image_alone() -> None:
    """A predictor that was just loaded is in training mode, whose statistics are the batch's."""
    predictor, images = ViewPredictor((1, 16, 16), 3, channels=4), torch.rand(6, 1, 16, 16)
    before = {name: value.clone() for name, value in predictor.state_dict().items()}
    fit = PredictorFit()
    whole = fit.probabilities(predictor, [images])
    assert torch.allclose(fit.probabilities(predictor, images.split(1)), whole, atol=1e-6)
    assert all(torch.equal(before[name], value) for name, value in predictor.state_dict().items())
