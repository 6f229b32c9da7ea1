"""Claims and verdicts with known answers; the figures name what exists."""

from __future__ import annotations

import inspect
import math

import numpy as np
import pytest
from scipy.stats import ttest_1samp

from unproject.data import chairs, correlated, digits
from unproject.domains import Images, Maps
from unproject.metrics import shape_scores
from unproject.recipes import find
from unproject.reproduce import FIGURES, Arm, Claim, Figure, overall, verdict
from unproject.reproduce.budgets import SIZES, flags_of
from unproject.reproduce.figure import Spread, StudentTest, pooled, student_test
from unproject.reproduce.figures_of_shapes import INITIAL_VIEWS_REASON
from unproject.reproduce.material_sources import PHOTOGRAPHED
from unproject.reproduce.scoring import score_materials
from unproject.reproduce.sources import SOURCES
from unproject.training import Options

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
    ("effects", "variance", "freedom", "expected"),
    [
        ([], 0.01, 4, "undecided"),
        ([5.0], 0.01, 4, "undecided"),
        ([0.5, 0.6], 0.01, 4, "holds"),
        ([-0.5, -0.6], 0.01, 4, "does not hold"),
        ([0.2, 0.2], 0.04, 4, "undecided"),  # t of four asks for 2.13 standard errors, and these are 1.41
        ([0.31, 0.31], 0.04, 4, "holds"),  # 2.19
        ([0.31, 0.31], 0.04, 1, "undecided"),  # t of one asks for 6.3
        ([0.2, 0.2, 0.2, 0.2], 0.03, 6, "holds"),  # 2.31 of 1.94
        ([0.01, 0.01], 0.0, 4, "undecided"),  # always the same, and nothing to speak of
        ([0.5, 0.5], 0.0, 0, "undecided"),  # no arm has two seeds
    ],
)
def test_a_verdict_needs_an_effect_beyond_the_spread_of_seeds(
    effects: list[float], variance: float, freedom: int, expected: str
) -> None:
    assert verdict(effects, Spread(variance, freedom)) == expected


def test_spreads_of_arms_are_pooled() -> None:
    found = pooled([[0.0, 2.0], [5.0, 5.0, 5.0], [7.0]])
    assert (found.variance, found.freedom) == (pytest.approx(2), 1)  # seeds that are all alike do not count
    both = pooled([[0.0, 2.0], [5.0, 5.0, 6.5]])
    assert (both.variance, both.freedom) == (pytest.approx((2 + 1.5) / 3), 3)
    assert pooled([[1.0], []]) == Spread(0, 0) and Spread(1.0, 3) * 2 == Spread(2.0, 3)


def test_a_test_is_students() -> None:
    rng = np.random.default_rng(0)
    effects = rng.normal(1, 1, 5).tolist()
    found = student_test(effects, Spread(float(np.var(effects, ddof=1)), 4))
    wanted = ttest_1samp(effects, 0, alternative="greater")
    assert found is not None and (found.t, found.p) == (pytest.approx(wanted.statistic), pytest.approx(wanted.pvalue))
    assert str(StudentTest(-2.1318, 4)) == "t(4) = -2.13, p = 0.05"
    assert str(StudentTest(90, 4)) == "t(4) = 90, p < 0.001"
    assert student_test([1.0], Spread(1, 4)) is student_test([1.0, 1.0], Spread(0, 0)) is None


@pytest.mark.parametrize("seeds", [2, 3, 5])
def test_chance_decides_one_claim_in_ten(seeds: int) -> None:
    """Four arms that are alike, the first two of which are compared."""
    rng = np.random.default_rng(0)
    arms = rng.normal(0, 1, (2000, 4, seeds)).tolist()
    found = [verdict([b - a for a, b in zip(*levels[:2], strict=True)], pooled(levels) * 2) for levels in arms]
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
    assert not figure.claims or any(not claim.beyond_paper for claim in figure.claims)  # type: ignore[attr-defined]


VIEWS = {"view_of_ceiling", "view_exact", "view_ceiling_exact"}
SHAPES = {"chairs", "birds", "cars"}


def scores_there_are(source: str) -> set[str]:
    """Names of the scores of a source's arms."""
    if source in SHAPES:
        return set(shape_scores(chairs(4, 16), chairs(4, 16, seed=1))) | VIEWS
    if source in ("digits", "mnist"):
        return set(Images().scores(digits(32)[:64], digits(32)[64:128])) | {"view_of_ceiling_mirrored"}
    maps = correlated(16, 16, 0)
    return set(score_materials(Maps(), maps, maps, source))


def test_claims_are_about_scores_that_there_are() -> None:
    source_of = {arm.name: arm.source for arm in ARMS}
    asked: dict[str, set[str]] = {}
    for figure in FIGURES.values():
        for claim in figure.claims:
            asked.setdefault(source_of[claim.better], set()).update(claim.scores)
        asked.setdefault(figure.arms[0].source, set()).update(figure.extra_scores)
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
    known = {*inspect.signature(find(arm.recipe)).parameters, *Options.__annotations__}  # type: ignore[attr-defined]
    assert set(flags) <= known and ("steps" in flags) != ("minutes" in flags)
    assert arm.source in SOURCES and not {"seed", "data", "steps", "minutes"} & set(arm.flags)  # type: ignore[attr-defined]


@pytest.mark.parametrize("figure", FIGURES.values(), ids=lambda f: f.name)
def test_a_figure_has_an_arm_with_the_papers_recipe_or_says_why_not(figure: Figure) -> None:
    assert any(arm.of_paper for arm in figure.arms) != bool(figure.no_paper_arm)


def test_only_the_cpu_budget_shortens_the_papers_view_predictor() -> None:
    arms = [arm for arm in ARMS if arm.of_paper and arm.flags.get("views", "predicted") == "predicted"]
    fitted = [arm.name for arm in arms if "predictor_steps" in flags_of(arm, "cpu")]
    assert sorted(set(fitted)) == ["birds-paper", "cars-paper", "chairs-paper", "digits-predicted-paper"]
    assert not any("predictor_steps" in flags_of(arm, "gpu") for arm in arms)


def test_an_arm_is_the_same_in_every_figure() -> None:
    by_name = {arm.name: arm for arm in ARMS}
    assert all(by_name[arm.name] == arm for arm in ARMS)


def test_the_cpu_budget_is_ten_minutes_an_arm() -> None:
    """Materials are budgeted in steps, so that all arms have as many, a step of 0.4 seconds."""
    for flags in SIZES["cpu"].values():
        assert flags.get("minutes", 0) <= 9.5 and flags.get("steps", 0) <= 1500
    # Two seeds, two at a time: arms of nine minutes and what a score takes, within the hour.
    assert all(len(figure.arms) * 10 <= 60 for figure in FIGURES.values())


def test_a_figure_with_an_arm_of_initialised_views_says_so() -> None:
    guessing = {f.name for f in FIGURES.values() if any(a.flags.get("init_views") for a in (*f.arms, *f.real))}
    assert guessing == {f.name for f in FIGURES.values() if INITIAL_VIEWS_REASON in f.deviations} == {"fig4", "fig5"}
