"""Matching in a run: it reaches the generator, sees what is not augmented, and a resumed run goes on with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch
from comparing import differences, final
from toy import SIZE, toy

from unproject._types import UserError
from unproject.adversarial import Augmentation, Matching, MatchingState
from unproject.training import Recipe, resume, train
from unproject.training.state import State

CPU = torch.device("cpu")


def matched(**settings: Any) -> Recipe:
    return replace(toy(steps=8, views="known"), matching=Matching(**settings), balance_every=16, checkpoint_every=3)


def test_a_run_that_is_resumed_goes_on_with_its_moving_means(tmp_path: Path) -> None:
    recipe = matched(weight=1.0, final=1.0)  # which do not depend on the budget
    whole = train(recipe, tmp_path / "whole", quiet=True).path
    part = train(replace(recipe, steps=5), tmp_path / "part", quiet=True).path
    assert resume(part, recipe, steps=8, quiet=True).step == 8
    assert not differences(part, whole)
    tensors = final(whole)
    for name in ("first", "second", "unit"):
        assert tensors[f"panels/0/matching/{name}"].abs().max() > 0


@pytest.mark.parametrize("every, updates", [(1, 8), (2, 4), (3, 3)])
def test_it_is_part_of_every_so_many_updates(every: int, updates: int, tmp_path: Path) -> None:
    tensors = final(train(matched(every=every), tmp_path / "run", quiet=True).path)
    assert tensors["panels/0/matching/seen"].item() == updates


def direction(tensors: dict[str, torch.Tensor]) -> torch.Tensor:
    """The generator's gradient of the only step, of norm 1."""
    found = [v for k, v in tensors.items() if k.startswith("generator_optimiser") and k.endswith("exp_avg")]
    gradient = torch.cat([value.flatten() for value in found])
    return gradient / gradient.norm()


def test_its_gradient_reaches_the_generator_and_nothing_else(tmp_path: Path) -> None:
    runs = [
        replace(recipe, steps=1)
        for recipe in (toy(views="known"), matched(weight=1e-9, final=0.0), matched(weight=1e3))
    ]
    without, light, heavy = (final(train(r, tmp_path / str(k), quiet=True).path) for k, r in enumerate(runs))
    for name, value in without.items():
        if name.startswith(("discriminators/", "discriminator_optimiser/")):
            assert torch.equal(heavy[name], value), name
    torch.testing.assert_close(direction(light), direction(without), rtol=1e-3, atol=1e-6)
    assert direction(heavy) @ direction(without) < 0.9


def test_it_sees_images_that_are_not_augmented(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Added(Augmentation):
        def __call__(self, images: torch.Tensor, rng: torch.Generator) -> torch.Tensor:
            return images + 5

    most, forward = [], MatchingState.forward

    def noted(self: MatchingState, images: torch.Tensor, *others: Any) -> torch.Tensor:
        most.append(images.max().item())
        return forward(self, images, *others)

    monkeypatch.setattr(MatchingState, "forward", noted)
    train(replace(matched(every=1), augmentation=Added()), tmp_path / "run", quiet=True)
    assert len(most) == 8 and max(most) <= 1.0


def test_its_weight_needs_the_norm_of_the_adversarial_gradient() -> None:
    with pytest.raises(UserError, match="does not measure; give balance_every=16"):
        replace(matched(), balance_every=0)


def test_volumes_and_small_pictures_are_refused() -> None:
    for shape in ((4, SIZE, SIZE), (4, 1, 4, 4)):
        with pytest.raises(UserError, match="needs pictures of 8 pixels a side or more"):
            Matching().begin(torch.zeros(shape))
    assert not any("matching" in name for name in State(toy(), CPU).tensors())


def test_a_single_picture_has_statistics() -> None:
    state = Matching().begin(torch.rand(1, 3, 16, 16, generator=torch.Generator().manual_seed(0)))
    assert state.unit.isfinite().all() and state(torch.rand(2, 3, 16, 16)).isfinite()
