"""What recipe.json says of a recipe: equal for equal ones, different for any change; and schedules and budgets."""

from __future__ import annotations

import copy
import json
import math
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor

from unproject._types import UserError
from unproject.adversarial.losses import Hinge
from unproject.assignment import Panel
from unproject.data import Collection
from unproject.networks import LowRankGenerator
from unproject.projections.base import Identity, Projection
from unproject.projections.observation import Observation
from unproject.projections.priors import Bins, Empirical, Uniform
from unproject.recipes.shapes import shapes, shapes_paper
from unproject.training import Adam, Recipe
from unproject.training.description import describe


def text(value: Any) -> str:
    return json.dumps(describe(value), allow_nan=False)


def small(**changes: Any) -> Recipe:
    items = torch.arange(2 * 8**3).view(2, 8, 8, 8) / 1024
    defaults = {
        "generator": partial(LowRankGenerator, size=8),
        "panels": [Panel([Observation("volume", Identity())], Collection(items))],
        "steps": 10,
    }
    return Recipe(**{**defaults, **changes})


@pytest.mark.parametrize("recipe", [shapes, shapes_paper])
@pytest.mark.parametrize("views", ["predicted", "known", "single", "direct"])
def test_equal_recipes_have_equal_descriptions(recipe: Any, views: str, volumes: Path) -> None:
    once, again = (recipe(data=volumes, views=views, size=16) for _ in range(2))
    assert text(once) == text(again)


CHANGES = [
    {"views": "known"},
    {"views": "single"},
    {"views": "learned"},
    {"views_per_sample": 4},
    {"ema_half_life": 10.0},
    {"balance_every": 5},
    {"discriminator_steps": 2},
    {"init_views": True},
    {"views": "direct"},
    {"bins": 8},
    {"bands": 3},
    {"views_per_shape": 4},
    {"binary": True},
    {"steps": 3},
    {"minutes": 1.0},
    {"seed": 1},
    {"batch": 32},
    {"channels": 64},
    {"rank": 16},
    {"density": 1.0},
    {"rate": 1e-4},
    {"gamma": 2.0},
    {"solid": 0.2},
    {"rounds": 3},
    {"mirror": False},
    {"flips": True},
    {"views_per_sample": 1},
    {"precision": "bfloat16"},
    {"compile": True},
    {"checkpoint_every": 100},
]


@pytest.mark.parametrize("change", CHANGES, ids=str)
def test_any_change_changes_the_description(change: dict[str, Any], volumes: Path) -> None:
    plain = {"data": volumes, "size": 16, "views_per_shape": 2, "precision": "float32"}
    assert text(shapes(**plain)) != text(shapes(**{**plain, **change}))


def test_data_are_told_apart_by_their_values() -> None:
    one, other = torch.zeros(2, 8, 8, 8), torch.zeros(2, 8, 8, 8)
    assert text(Collection(one)) == text(Collection(other))
    other[1, 3, 4, 5] = 1e-6
    assert text(Collection(one)) != text(Collection(other))
    assert text(Collection(one)) != text(Collection(one.view(2, 8, 64)))


@pytest.mark.parametrize(
    "one, other",
    [
        (Uniform("a", 0, 1), Uniform("a", 0, 1, 2.0)),
        (Bins("a", 4), Bins("a", 4, centre=0.1)),
        (Empirical({"a": torch.zeros(2)}), Empirical({"a": torch.ones(2)})),
        (partial(LowRankGenerator, 8), partial(LowRankGenerator, 16)),
        (partial(LowRankGenerator, size=8), partial(LowRankGenerator, rank=8)),
        (LowRankGenerator, Recipe),
        ({"a": [1, 2.0]}, {"a": [1, 2.5]}),
        (math.inf, -math.inf),
        (True, "True"),
        (None, 0),
    ],
    ids=str,
)
def test_unlike_parts_have_unlike_descriptions(one: Any, other: Any) -> None:
    assert text(one) != text(other)


class Plain:
    """A user's part without fields of a dataclass."""

    def __init__(self, strength: float) -> None:
        self.strength = strength


def test_a_users_object_is_described_by_what_it_holds() -> None:
    assert text(Plain(1.0)) == text(Plain(1.0)) != text(Plain(2.0))
    assert describe(Plain(1.0))["type"].endswith(":Plain")


# The recipe itself


def test_a_recipe_derives_from_another() -> None:
    plain = small()
    changed = plain.replace(loss=Hinge())
    assert changed.loss == Hinge() and changed.panels is plain.panels and plain.loss != Hinge()


@pytest.mark.parametrize(
    "change, message",
    [
        ({"panels": []}, "has no panels"),
        ({"batch": 0}, "batch=0: must be at least 1"),
        ({"discriminator_steps": 0}, "discriminator_steps=0"),
        ({"views_per_sample": 0}, "views_per_sample=0"),
        ({"batch": 6, "views_per_sample": 4}, "batch=6: must be a multiple of views_per_sample=4"),
        ({"checkpoint_every": 0}, "checkpoint_every=0"),
        ({"steps": 0}, "steps=0: must be positive"),
        ({"minutes": -1.0}, "minutes=-1.0: must be positive"),
        ({"minutes": math.inf}, "minutes=inf: must be positive"),
        ({"steps": None}, "no budget"),
    ],
    ids=str,
)
def test_wrong_recipes_are_refused(change: dict[str, Any], message: str) -> None:
    with pytest.raises(UserError, match=message):
        small(**change)


def test_the_budget_that_is_spent_first_counts() -> None:
    recipe = small(steps=100, minutes=2.0)
    assert recipe.progress(50, 30) == 0.5 and recipe.progress(10, 90) == 0.75
    assert small(steps=100).progress(25, 1e9) == 0.25
    assert small(steps=None, minutes=1.0).progress(10**9, 15) == 0.25


def test_the_learning_rate_falls_along_a_cosine() -> None:
    adam = Adam(rate=4.0, final=2.0)
    assert [adam.rate_at(p) for p in (0, 0.5, 1, 1.5)] == pytest.approx([4, 3, 2, 2])
    assert adam.rate_at(1 / 3) == pytest.approx(3.5)
    assert [Adam(rate=4.0).rate_at(p) for p in (0, 0.5, 1)] == [4, 4, 4]


def test_an_operator_of_ones_own_is_described_with_its_attributes() -> None:
    class Scaled(Projection):
        def __init__(self, factor: float) -> None:
            self.factor = factor

        def forward(self, x: Tensor) -> Tensor:
            return x * self.factor

    assert describe(Scaled(2.0)) == describe(Scaled(2.0)) != describe(Scaled(3.0))


class Holder:
    def __init__(self, part: Any) -> None:
        self.part = part


@pytest.mark.parametrize(
    "one, other",
    [
        (np.ones(4), np.zeros(4)),
        (np.ones(4), np.ones((2, 2))),
        (np.float32(1), np.float32(2)),
        ({1, 2}, {1, 3}),
        (torch.float32, torch.float64),
    ],
    ids=str,
)
def test_what_an_operator_of_ones_own_may_hold(one: Any, other: Any) -> None:
    assert text(Holder(one)) == text(Holder(copy.copy(one))) != text(Holder(other))


def test_what_cannot_be_described_is_refused() -> None:
    with pytest.raises(UserError, match="builtins:object cannot be written to recipe.json"):
        describe(Holder(object()))
