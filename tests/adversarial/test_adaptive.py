"""Adaptive strength: up while the discriminator overfits, down while it does not, as far as the budget is spent."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from unproject._types import UserError
from unproject.adversarial.adaptive import Adaptive
from unproject.adversarial.augmentation import Affine, Augmentation, Shift


class Marked(Augmentation):
    def __call__(self, images: Tensor, rng: torch.Generator) -> Tensor:
        return images + 1


def after(measures: list[tuple[float, float, float]], **settings: float) -> list[float]:
    """The strength after each measurement of (train, held-out, generated), a tenth of the budget apart."""
    state = Adaptive(Affine(), **settings).begin()  # pyright: ignore[reportArgumentType]
    found = []
    for i, measured in enumerate(measures):
        state.adapt(*measured, progress=(i + 1) / 10)
        found.append(round(state.strength.item(), 6))
    return found


OVERFITTED, SOUND = (3.0, 1.0, -1.0), (3.0, 2.9, -1.0)


def test_the_strength_rises_with_overfitting_and_falls_without() -> None:
    assert after([OVERFITTED] * 3, rise=0.5) == [0.2, 0.4, 0.6]
    assert after([SOUND] * 3, rise=0.5, start=0.5) == [0.3, 0.1, 0.0]


def test_it_stays_within_its_limit() -> None:
    assert after([OVERFITTED] * 6, rise=0.5, most=0.7) == [0.2, 0.4, 0.6, 0.7, 0.7, 0.7]
    assert after([OVERFITTED] * 3, rise=0.5, most=0.0) == [0.0, 0.0, 0.0]


def test_overfitting_is_the_way_from_training_to_generated_images() -> None:
    """Whatever the offset and the scale of the logits, which a relativistic loss leaves free."""
    for scale, offset in ((1.0, 0.0), (100.0, 7.0), (0.01, -3.0)):
        state = Adaptive(Affine()).begin()
        for i in range(20):
            train, held_out, generated = (scale * value + offset for value in (3.0, 2.0, -1.0))
            state.adapt(train, held_out, generated, i / 20)
        assert state.overfitting == pytest.approx(0.25) and state.log()["overfitting"] == 0.25


def test_many_measurements_decide() -> None:
    """One that says otherwise is noise; a few in a row are not."""
    ones = after([OVERFITTED] * 5 + [SOUND] + [OVERFITTED], rise=1.0)
    assert ones == pytest.approx([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7])
    assert after([OVERFITTED] * 5 + [SOUND] * 5, rise=1.0, most=1.0)[-1] < 0.9


def test_a_discriminator_that_cannot_tell_generated_images_does_not_overfit() -> None:
    assert after([(0.0, -1.0, 0.5)] * 2, rise=0.5, start=0.8) == [0.6, 0.4]


def test_the_target_is_the_one_that_is_asked_for() -> None:
    """r is 0.5."""
    assert after([OVERFITTED], rise=0.5, target=0.45) == [0.2]
    assert after([OVERFITTED], rise=0.5, target=0.55, start=0.5) == [0.3]


def test_after_a_larger_budget_it_goes_on_from_where_it_was() -> None:
    state = Adaptive(Affine(), rise=1.0).begin()
    for progress in (0.5, 0.25, 0.35):  # of twice the budget from the second on
        state.adapt(*OVERFITTED, progress=progress)
    assert state.strength.item() == pytest.approx(0.6)


def test_the_strength_is_the_share_of_images_that_are_augmented() -> None:
    settings = Adaptive(Marked(), rise=0.5)
    state, images = settings.begin(), torch.zeros(4000, 1, 2, 2)
    assert torch.equal(state(images, torch.Generator()), images)
    for progress in (0.1, 0.2):
        state.adapt(*OVERFITTED, progress=progress)
    assert state(images, torch.Generator().manual_seed(0)).mean().item() == pytest.approx(0.4, abs=0.03)
    assert torch.equal(settings(images, torch.Generator()), images)


def test_a_state_comes_back_bit_for_bit() -> None:
    state, again = Adaptive(Affine()).begin(), Adaptive(Affine()).begin()
    for i in range(5):
        state.adapt(*(math.sin(i + k) for k in range(3)), progress=i / 9)
    again.load_state_dict(state.state_dict())
    for part in (state, again):
        part.adapt(*OVERFITTED, progress=0.7)
    assert state.log() == again.log() and not Shift(1.0).begin().state_dict()


def test_the_penalty_grows_with_the_strength() -> None:
    """To `penalty` times, by equal factors in equal steps; that of an augmentation that does not adapt stays."""
    state = Adaptive(Affine(), rise=0.5, most=0.8, penalty=16.0).begin()
    found = [state.penalty_scale]
    for i in range(5):
        state.adapt(*OVERFITTED, progress=(i + 1) / 10)
        found.append(state.penalty_scale)
    assert found == pytest.approx([1, 2, 4, 8, 16, 16])
    assert Shift(1.0).begin().penalty_scale == Adaptive(Affine(), most=0.0, penalty=9.0).begin().penalty_scale == 1
    with pytest.raises(UserError, match="give a positive factor"):
        Adaptive(Affine(), penalty=0.0)


def test_measurements_are_so_many_updates_apart() -> None:
    due = [draw for draw in range(10) if Adaptive(Affine(), every=4).begin().due(draw)]
    assert due == [3, 7] and not Shift(1.0).begin().due(3)


@pytest.mark.parametrize(
    "wrong", [{"target": 1.5}, {"every": 0}, {"rise": 0.0}, {"start": 0.9}, {"most": 1.1}], ids=str
)
def test_numbers_out_of_range_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(UserError, match="give a target between 0 and 1"):
        Adaptive(Affine(), **wrong)  # pyright: ignore[reportArgumentType]
