"""What is kept of a figure's arms, and what it says of the figure's claims."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from statistics import mean

from .figure import Claim, Figure, Spread, Verdict, overall, pooled, verdict
from .kept import Kept


@dataclass(frozen=True)
class Judged:
    """A claim, its effect at each seed that both arms have, how far seeds spread such an effect, and the verdict.

    `measured` is the score that it is about, of each arm that it names.
    """

    claim: Claim
    effects: tuple[float, ...]
    spread: Spread
    measured: Mapping[str, float] = field(default_factory=dict)

    @property
    def verdict(self) -> Verdict:
        return verdict(self.effects, self.spread)

    @property
    def text(self) -> str:
        return f"Beyond the paper: {self.claim.text}" if self.claim.ours else self.claim.text

    @property
    def said(self) -> str:
        """The verdict; undecided, though all seeds are on one side, is not the same as contradicted."""
        if self.verdict != "undecided" or len(self.effects) < 2:
            return self.verdict
        good = [effect > 0 for effect in self.effects]
        leaning = "every seed as claimed" if all(good) else "seeds disagree" if any(good) else "no seed as claimed"
        return f"undecided ({leaning})"


@dataclass(frozen=True)
class Report:
    """A figure and what is kept of its arms: (arm, seed) → result; and of true things: name → result."""

    figure: Figure
    kept: dict[tuple[str, int], Kept]
    truths: dict[str, Kept] = field(default_factory=dict)

    @cached_property
    def judged(self) -> tuple[Judged, ...]:
        real = {arm.name for arm in self.figure.real}
        judged = [
            Judged(claim, self._effects(claim), self._spread(claim), self._measured(claim))
            for claim in self.figure.claims
        ]
        return tuple(one for one in judged if one.effects or not {one.claim.better, one.claim.than} & real)

    @property
    def verdict(self) -> Verdict:
        """Of the paper's claims; those beyond it, and those of real collections that are not at hand, do not count."""
        return overall([one.verdict for one in self.judged if not one.claim.ours])

    def seeds(self, arm: str) -> list[int]:
        return sorted(seed for name, seed in self.kept if name == arm)

    @cached_property
    def values(self) -> dict[tuple[str, int], dict[str, float]]:
        return {key: kept.values() for key, kept in self.kept.items()}

    def _effects(self, claim: Claim) -> tuple[float, ...]:
        truth = self.truths[claim.than].values() if claim.than in self.truths else None
        found = []
        for seed in self.seeds(claim.better):
            better, than = self.values[claim.better, seed], truth or self.values.get((claim.than, seed))
            if claim.than and than is None:
                continue
            if all(name in side for name in claim.scores for side in (better, than) if side is not None):
                found.append(claim.effect(better, than))
        return tuple(found)

    def _spread(self, claim: Claim) -> Spread:
        """Of an effect: that between the seeds of an arm, of all arms alike together; of two arms, twice.

        Alike are those that are scored against the same things: collections differ in how far seeds spread.
        """
        alike = [arm for arm, source in self.sources.items() if source == self.sources[claim.better]]
        levels = {arm: found for arm in alike if (found := self._levels(claim, arm))}
        return pooled(levels.values()) * (2 if claim.than in levels else 1)

    @property
    def sources(self) -> dict[str, str]:
        return {arm.name: arm.source for arm in (*self.figure.arms, *self.figure.real)}

    def _levels(self, claim: Claim, arm: str) -> list[float]:
        """The level of an arm's scores, or of true things', one a seed."""
        found = [self.truths[arm].values()] if arm in self.truths else [self.values[arm, s] for s in self.seeds(arm)]
        return [claim.level(values) for values in found if all(score in values for score in claim.scores)]

    def _measured(self, claim: Claim) -> dict[str, float]:
        """What a claim is about: its score of each arm, the geometric mean over seeds."""
        levels = {arm: self._levels(claim, arm) for arm in (claim.better, claim.than) if arm}
        return {arm: math.exp(mean(found)) for arm, found in levels.items() if found}
