"""What a figure of the paper is here: arms that are trained, claims about their scores, and how much of it holds."""

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


@dataclass(frozen=True)
class Arm:
    """One training: a recipe and the flags that make it this arm.

    Attributes:
        name: of its results; the same in every figure that shows it, so that nothing is trained twice.
        recipe: a built-in recipe.
        source: of `sources.SOURCES`: what it learns from, and what it is scored against.
        says: the same in words, for the table.
        flags: of the recipe, besides the budget's and the source's.
    """

    name: str
    recipe: str
    source: str
    says: str
    flags: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Claim:
    """Of an arm's score against another's, or against a number.

    The effect at one seed is a logarithm, positive if it is as claimed: of `than`'s score over `better`'s and over
    `factor`; without `than`, of `factor` over `better`'s score. With `higher` both are the other way round. Several
    scores count as their geometric mean.

    Attributes:
        text: what is claimed.
        better: the arm that is said to be better.
        than: the arm it is compared with; none if empty.
        scores: names of scores.
        factor: how many times better; or the number itself.
        higher: whether more is better.
        ours: whether it goes beyond the paper, and says nothing of the paper's figure.
    """

    text: str
    better: str
    than: str
    scores: tuple[str, ...]
    factor: float = 1.0
    higher: bool = False
    ours: bool = False

    def effect(self, better: Mapping[str, float], than: Mapping[str, float] | None = None) -> float:
        level, wanted = self.level(better), math.log(self.factor)
        other = self.level(than) if than is not None else 0.0
        if than is None:
            return level - wanted if self.higher else wanted - level
        return (level - other if self.higher else other - level) - wanted

    def level(self, values: Mapping[str, float]) -> float:
        """The mean logarithm of the scores."""
        return mean(math.log(max(values[score], LEAST)) for score in self.scores)


def ahead_of_paper(ours: str, paper: str, scores: tuple[str, ...]) -> Claim:
    """This project's aim, beyond the paper."""
    text = "At most a third of the distance of the paper's own recipe in the same budget"
    return Claim(text, ours, paper, scores, factor=3, ours=True)


NARROW = (
    "Networks, batches and samples of a rendering are smaller for the paper's recipe in the cpu budget, alike in all "
    "its arms: full ones take days there."
)
NOTHING = math.log(1.02)  # two per cent: less is nothing to speak of, however often it is the same
LEAST = 1e-9  # a score of nothing at all still has a logarithm


@dataclass(frozen=True)
class Figure:
    """A figure of the paper.

    Attributes:
        name: fig7.
        title: what it shows.
        claim: the paper's, in one sentence.
        says: what the paper says of it.
        arms: what is trained.
        real: what is trained besides where there are real collections.
        claims: what is measured of it.
        also: further scores for the table, and whether more or less of each is better.
        caption: of the picture.
        deviations: from the paper, each with its reason.
        shows: in the picture: what arms make, or training images grouped by predicted view.
    """

    name: str
    title: str
    claim: str
    says: str
    arms: tuple[Arm, ...] = ()
    real: tuple[Arm, ...] = ()
    claims: tuple[Claim, ...] = ()
    also: Mapping[str, Better] = field(default_factory=dict)
    caption: str = ""
    deviations: tuple[str, ...] = ()
    shows: Literal["things", "views"] = "things"

    @property
    def scores(self) -> dict[str, Better]:
        """Those of its table, and whether more or less of each is better."""
        of_claims: dict[str, Better] = {
            score: "more" if claim.higher else "less" for claim in self.claims for score in claim.scores
        }
        return of_claims | dict(self.also)


@dataclass(frozen=True)
class Spread:
    """How far apart seeds lie: a variance, and the degrees of freedom with which it is known."""

    variance: float
    freedom: int

    def __mul__(self, factor: float) -> Spread:
        return Spread(self.variance * factor, self.freedom)


def pooled(levels: Iterable[Sequence[float]]) -> Spread:
    """Of the levels of several arms, one a seed: Σ (x - its arm's mean)² / Σ (seeds - 1)."""
    known = [arm for arm in levels if len(arm) > 1]
    freedom = sum(len(arm) - 1 for arm in known)
    return Spread(sum((len(arm) - 1) * variance(arm) for arm in known) / max(freedom, 1), freedom)


def verdict(effects: Sequence[float], spread: Spread) -> Verdict:
    """Of the effects of a claim, one a seed, each of this spread: Student's t test, five per cent on either side.

    One seed alone, and a mean effect of less than NOTHING, leave it undecided.
    """
    if len(effects) < 2 or spread.freedom < 1 or abs(mean(effects)) < NOTHING:
        return "undecided"
    error = math.sqrt(spread.variance / len(effects))
    if abs(mean(effects)) <= float(student.ppf(0.95, spread.freedom)) * error:
        return "undecided"
    return "holds" if mean(effects) > 0 else "does not hold"


def overall(verdicts: Sequence[Verdict]) -> Verdict:
    """Of a figure: it holds if every claim does, and does not if one does not."""
    if not verdicts or "undecided" in verdicts and "does not hold" not in verdicts:
        return "undecided"
    return "does not hold" if "does not hold" in verdicts else "holds"
