"""Claims and verdicts with known answers; the figures name what exists."""

from __future__ import annotations

import inspect
import math

import numpy as np
import pytest

from unproject.data import chairs, correlated, digits
from unproject.metrics import image_scores, shape_scores
from unproject.recipes import find
from unproject.reproduce import FIGURES, Arm, Claim, overall, verdict
from unproject.reproduce.budgets import SIZES, flags_of
from unproject.reproduce.scoring import score_materials
from unproject.reproduce.sources import PHOTOGRAPHED, SOURCES

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
        ([0.01, 0.01], "undecided"),  # always the same, and nothing to speak of
        ([0.5, 0.8], "undecided"),  # Student's t of two asks for 6.3 standard errors
        ([0.5, 0.8, 0.65], "holds"),
        ([-0.1, 0.5, 0.6, 0.5, 0.6, 0.5], "holds"),  # one seed of many may differ
    ],
)
def test_a_verdict_needs_seeds_that_agree(effects: list[float], expected: str) -> None:
    assert verdict(effects) == expected


@pytest.mark.parametrize("seeds", [2, 3, 5])
def test_chance_decides_one_claim_in_ten(seeds: int) -> None:
    rng = np.random.default_rng(0)
    found = [verdict(effects) for effects in rng.normal(0, 1, (2000, seeds)).tolist()]
    for way in ("holds", "does not hold"):
        assert 0.035 < found.count(way) / len(found) < 0.065


def test_a_figure_holds_if_all_of_it_does() -> None:
    assert overall(["holds", "holds"]) == "holds"
    assert overall(["holds", "undecided"]) == "undecided"
    assert overall(["holds", "undecided", "does not hold"]) == "does not hold"
    assert overall([]) == "undecided"


@pytest.mark.parametrize("figure", FIGURES.values(), ids=lambda f: f.name)
def test_claims_are_about_arms_of_the_figure(figure: object) -> None:
    arms = (*figure.arms, *figure.real)  # type: ignore[attr-defined]
    names = {arm.name for arm in arms} | {f"{kind}-{arm.source}" for arm in arms for kind in ("truth", "shuffled")}
    for claim in figure.claims:  # type: ignore[attr-defined]
        assert {claim.better, claim.than} - {""} <= names and claim.scores
    assert not figure.claims or any(not claim.ours for claim in figure.claims)  # type: ignore[attr-defined]


SHAPES = {"chairs", "birds", "cars"}


def scores_there_are(source: str) -> set[str]:
    """Names of the scores of a source's arms."""
    if source in SHAPES:
        return set(shape_scores(chairs(4, 16), chairs(4, 16, seed=1))) | {"view_of_ceiling"}
    if source in ("digits", "mnist"):
        return set(image_scores(digits(32)[:64], digits(32)[64:128]))
    maps = correlated(16, 16, 0)
    return set(score_materials(maps, maps, source))


def test_claims_are_about_scores_that_there_are() -> None:
    source_of = {arm.name: arm.source for arm in ARMS}
    asked: dict[str, set[str]] = {}
    for figure in FIGURES.values():
        for claim in figure.claims:
            asked.setdefault(source_of[claim.better], set()).update(claim.scores)
    for source, names in asked.items():
        assert names <= scores_there_are(source), source


@pytest.mark.parametrize("arm", [arm for arm in ARMS if arm.source in PHOTOGRAPHED], ids=lambda a: a.name)
def test_photographs_are_as_many_as_the_table_says(arm: Arm) -> None:
    maps, renderings = PHOTOGRAPHED[arm.source]
    assert arm.flags["maps"] >= maps and arm.flags["renderings"] == renderings


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
    """Materials are budgeted in steps, so that all arms have as many; a step takes 0.4 seconds at most."""
    for flags in SIZES["cpu"].values():
        assert flags.get("minutes", 0) <= 9.5 and flags.get("steps", 0) <= 1500
    # Two seeds, two at a time: arms of nine minutes and what a score takes, within the hour.
    assert all(len(figure.arms) * 10 <= 60 for figure in FIGURES.values())
