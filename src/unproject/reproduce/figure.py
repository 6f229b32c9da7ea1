"""Define a figure of the paper: arms to train, claims about their scores, and the test that decides a claim."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import mean, variance
from typing import Any, Literal

from scipy.stats import t as student

Verdict = Literal["holds", "does not hold", "undecided"]
Budget = Literal["cpu", "gpu"]
Better = Literal["more", "less"]

NEGLIGIBLE = math.log(1.02)
"""A mean effect below two per cent leaves a claim undecided, however small the variance between seeds."""
SMALLEST = 1e-9
"""Scores are clamped to this before their logarithm is taken."""


@dataclass(frozen=True)
class Arm:
    """One training: a recipe and its flags.

    Attributes:
        name: of its results. An arm that several figures show has the same name in each, and is trained once.
        recipe: name of a built-in recipe.
        source: key of `sources.SOURCES`: the training data and the reference of its scores.
        description: of the arm in one line, for the report.
        flags: of the recipe, besides those of the budget and of the source.
    """

    name: str
    recipe: str
    source: str
    description: str
    flags: Mapping[str, Any] = field(default_factory=dict)

    @property
    def of_paper(self) -> bool:
        """Whether the recipe is one of the paper's."""
        return self.recipe.endswith("-paper")


@dataclass(frozen=True)
class Claim:
    """A claim that one arm's score beats another arm's, or a number, by a factor.

    The effect at one seed is log(score of `than` / score of `better` / factor), positive where the claim is true.
    Without `than` it is log(factor / score of `better`). With `higher` both signs are reversed, as more is better then.
    For several scores, their geometric mean is taken.

    Attributes:
        text: the claim in words.
        better: name of the arm that the claim says is better.
        than: name of the arm that it is compared with; empty for a comparison with `factor` itself.
        scores: names of the scores.
        factor: how many times better; or the number itself.
        higher: whether a higher score is better.
        beyond_paper: whether the claim is this project's own, and does not count for the verdict on the figure.
    """

    text: str
    better: str
    than: str
    scores: tuple[str, ...]
    factor: float = 1.0
    higher: bool = False
    beyond_paper: bool = False

    def effect(self, better: Mapping[str, float], than: Mapping[str, float] | None = None) -> float:
        """Return the effect of one seed, from the scores of both arms."""
        level, threshold = self.level(better), math.log(self.factor)
        other = self.level(than) if than is not None else 0.0
        if than is None:
            return level - threshold if self.higher else threshold - level
        return (level - other if self.higher else other - level) - threshold

    def level(self, values: Mapping[str, float]) -> float:
        """Return the mean logarithm of the scores."""
        return mean(math.log(max(values[score], SMALLEST)) for score in self.scores)


def ahead_of_paper(ours: str, paper: str, scores: tuple[str, ...]) -> Claim:
    """Return the claim that an arm has at most a third of the distance of the paper's recipe."""
    text = "At most a third of the distance of the paper's own recipe"
    return Claim(text, ours, paper, scores, factor=3, beyond_paper=True)


@dataclass(frozen=True)
class Figure:
    """A figure of the paper.

    Attributes:
        name: fig7.
        title: what the figure shows.
        claim: the paper's claim, in one sentence.
        paper_says: what the paper reports for it.
        arms: trained on embedded data.
        real: trained besides where `--data` is given.
        claims: tested on the scores of the arms.
        extra_scores: further columns of the score table, and whether more or less of each is better.
        caption: of the picture.
        deviations: from the paper in this figure, each with its reason.
        no_paper_arm: why no arm has the paper's recipe; empty where one has.
        shows: contents of the picture: samples of the arms, or training images grouped by predicted view.
    """

    name: str
    title: str
    claim: str
    paper_says: str
    arms: tuple[Arm, ...] = ()
    real: tuple[Arm, ...] = ()
    claims: tuple[Claim, ...] = ()
    extra_scores: Mapping[str, Better] = field(default_factory=dict)
    caption: str = ""
    deviations: tuple[str, ...] = ()
    no_paper_arm: str = ""
    shows: Literal["samples", "views"] = "samples"

    @property
    def label(self) -> str:
        """Fig. 7."""
        return self.name.replace("fig", "Fig. ")

    @property
    def scores(self) -> dict[str, Better]:
        """The columns of its score table, and whether more or less of each is better."""
        of_claims: dict[str, Better] = {
            score: "more" if claim.higher else "less" for claim in self.claims for score in claim.scores
        }
        return of_claims | dict(self.extra_scores)


@dataclass(frozen=True)
class Spread:
    """A variance between seeds and the degrees of freedom of its estimate."""

    variance: float
    freedom: int

    def __mul__(self, factor: float) -> Spread:
        return Spread(self.variance * factor, self.freedom)


def pooled(levels: Iterable[Sequence[float]]) -> Spread:
    """Pool the variance of several arms, each a sequence of levels by seed: Σ (x - its arm's mean)² / Σ (seeds - 1).

    Arms whose seeds are all alike are left out: their scores are at a bound, and say nothing of how seeds differ.
    """
    known = [arm for arm in levels if len(set(arm)) > 1]
    freedom = sum(len(arm) - 1 for arm in known)
    return Spread(sum((len(arm) - 1) * variance(arm) for arm in known) / max(freedom, 1), freedom)


@dataclass(frozen=True)
class StudentTest:
    """Student's t of a mean effect, the degrees of freedom, and the chance p of one as large on this side."""

    t: float
    freedom: int

    @property
    def p(self) -> float:
        return float(student.sf(abs(self.t), self.freedom))

    def __str__(self) -> str:
        p = "p < 0.001" if self.p < 0.001 else f"p = {self.p:.2g}"
        return f"t({self.freedom}) = {self.t:.3g}, {p}"


def student_test(effects: Sequence[float], spread: Spread) -> StudentTest | None:
    """Test the mean of effects, one a seed; None of one seed alone, and where no variance between seeds is known."""
    if len(effects) < 2 or spread.freedom < 1 or not spread.variance:
        return None
    return StudentTest(mean(effects) / math.sqrt(spread.variance / len(effects)), spread.freedom)


def verdict(effects: Sequence[float], spread: Spread) -> Verdict:
    """Test a claim by its effects, one a seed: Student's t test, five per cent on either side.

    What cannot be tested, or a mean effect below NEGLIGIBLE, leaves it undecided.
    """
    found = student_test(effects, spread)
    if found is None or abs(mean(effects)) < NEGLIGIBLE or found.p >= 0.05:
        return "undecided"
    return "holds" if found.t > 0 else "does not hold"


def overall(verdicts: Sequence[Verdict]) -> Verdict:
    """Return the verdict on a figure: it holds if every claim holds, and does not hold if one does not."""
    if not verdicts or "undecided" in verdicts and "does not hold" not in verdicts:
        return "undecided"
    return "does not hold" if "does not hold" in verdicts else "holds"
