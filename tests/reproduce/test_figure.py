"""Claims and verdicts with known answers; the figures name what exists."""

from __future__ import annotations

import inspect
import math

import pytest

from unproject.recipes import find
from unproject.reproduce import FIGURES, Claim, overall, verdict
from unproject.reproduce.budgets import SIZES, flags_of
from unproject.reproduce.sources import SOURCES

ARMS = [arm for figure in FIGURES.values() for arm in (*figure.arms, *figure.real)]


def test_an_effect_is_how_many_times_better() -> None:
    claim = Claim("nearer", "a", "b", ("x",))
    assert claim.effect({"x": 1.0}, {"x": 2.0}) == pytest.approx(math.log(2))
    assert Claim("thrice", "a", "b", ("x",), factor=3).effect({"x": 1.0}, {"x": 2.0}) == pytest.approx(math.log(2 / 3))
    assert Claim("more", "a", "b", ("x",), higher=True).effect({"x": 4.0}, {"x": 2.0}) == pytest.approx(math.log(2))
    both = Claim("both", "a", "b", ("x", "y"))
    assert both.effect({"x": 1.0, "y": 1.0}, {"x": 4.0, "y": 1.0}) == pytest.approx(math.log(2))


def test_an_effect_against_a_number() -> None:
    assert Claim("small", "a", "", ("x",), factor=0.2).effect({"x": 0.1}) == pytest.approx(math.log(2))
    assert Claim("large", "a", "", ("x",), factor=0.5, higher=True).effect({"x": 0.25}) == pytest.approx(-math.log(2))
    assert Claim("nothing", "a", "b", ("x",)).effect({"x": 0.0}, {"x": 0.0}) == 0


@pytest.mark.parametrize(
    ("effects", "expected"),
    [
        ([], "undecided"),
        ([5.0], "undecided"),
        ([0.5, 0.6], "holds"),
        ([-0.5, -0.6], "does not hold"),
        ([0.5, -0.1], "undecided"),
        ([0.1, 2.0], "undecided"),
        ([0.0, 0.5], "undecided"),
        ([0.5, 0.6, 0.55], "holds"),
    ],
)
def test_a_verdict_needs_seeds_that_agree(effects: list[float], expected: str) -> None:
    assert verdict(effects) == expected


def test_a_figure_holds_if_all_of_it_does() -> None:
    assert overall(["holds", "holds"]) == "holds"
    assert overall(["holds", "undecided"]) == "undecided"
    assert overall(["holds", "undecided", "does not hold"]) == "does not hold"
    assert overall([]) == "undecided"


@pytest.mark.parametrize("figure", FIGURES.values(), ids=lambda f: f.name)
def test_claims_are_about_arms_of_the_figure(figure: object) -> None:
    names = {arm.name for arm in figure.arms}  # type: ignore[attr-defined]
    for claim in figure.claims:  # type: ignore[attr-defined]
        assert {claim.better, claim.than} - {""} <= names and claim.scores


@pytest.mark.parametrize("arm", ARMS, ids=lambda a: a.name)
@pytest.mark.parametrize("budget", ["cpu", "gpu"])
def test_arms_have_flags_that_their_recipes_take(arm: object, budget: str) -> None:
    flags = flags_of(arm, budget)  # type: ignore[arg-type]
    known = inspect.signature(find(arm.recipe)).parameters  # type: ignore[attr-defined]
    assert set(flags) <= set(known) and ("steps" in flags) != ("minutes" in flags)
    assert arm.source in SOURCES and not {"seed", "data", "steps", "minutes"} & set(arm.flags)  # type: ignore[attr-defined]


def test_an_arm_is_the_same_in_every_figure() -> None:
    by_name = {arm.name: arm for arm in ARMS}
    assert all(by_name[arm.name] == arm for arm in ARMS)


def test_the_cpu_budget_is_ten_minutes_an_arm() -> None:
    """Materials are budgeted in steps, so that all arms have as many; a step takes a third of a second."""
    for flags in SIZES["cpu"].values():
        assert flags.get("minutes", 0) <= 9.5 and flags.get("steps", 0) <= 1500
    # Two seeds, two at a time: arms of nine minutes and what a score takes, within the hour.
    assert all(len(figure.arms) * 10 <= 60 for figure in FIGURES.values())
