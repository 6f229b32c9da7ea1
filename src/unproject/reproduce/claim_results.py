"""Compute the effects and verdicts of a figure's claims from the stored results of its arms."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from statistics import mean

from .figure import Claim, Figure, Spread, Verdict, overall, pooled, student_test, verdict
from .result import Result

MACHINE = ("cuda", "processor", "threads")
"""What says how many steps the minutes of a budget are."""


@dataclass(frozen=True)
class ClaimResult:
    """A claim with its measured effects.

    Attributes:
        claim: the claim.
        effects: one a seed that both arms have.
        spread: variance of such an effect between seeds.
        measured: the score of each arm that the claim names, the geometric mean over seeds.
        unlike: in what else than the claim is about the two arms, or seeds, may differ: commits, minutes, machines.
    """

    claim: Claim
    effects: tuple[float, ...]
    spread: Spread
    measured: Mapping[str, float] = field(default_factory=dict)
    unlike: tuple[str, ...] = ()

    @property
    def verdict(self) -> Verdict:
        return verdict(self.effects, self.spread)

    @property
    def text(self) -> str:
        return f"Beyond the paper: {self.claim.text}" if self.claim.beyond_paper else self.claim.text

    @property
    def verdict_text(self) -> str:
        """The verdict, its test, how many seeds agree with an undecided claim, and in what the two arms are unlike."""
        found = student_test(self.effects, self.spread)
        remarks = [*([str(found)] if found else []), *self.unlike]
        if self.verdict == "undecided" and len(self.effects) > 1:
            positive = [effect > 0 for effect in self.effects]
            some = "seeds disagree" if any(positive) else "no seed in favour"
            remarks.insert(1 if found else 0, "all seeds in favour" if all(positive) else some)
        return f"{self.verdict} ({'; '.join(remarks)})" if remarks else self.verdict


@dataclass(frozen=True)
class Report:
    """A figure and its stored results.

    Attributes:
        figure: the figure.
        results: (arm, seed) → result.
        truths: name → result of true samples, such as truth-wood and shuffled-wood.
    """

    figure: Figure
    results: dict[tuple[str, int], Result]
    truths: dict[str, Result] = field(default_factory=dict)

    @cached_property
    def claim_results(self) -> tuple[ClaimResult, ...]:
        """Those of all claims, except claims about real collections of which there is no result."""
        real = {arm.name for arm in self.figure.real}
        found = [
            ClaimResult(claim, self._effects(claim), self._spread(claim), self._measured(claim), self._unlike(claim))
            for claim in self.figure.claims
        ]
        return tuple(one for one in found if one.effects or not {one.claim.better, one.claim.than} & real)

    @property
    def verdict(self) -> Verdict:
        """The verdict on the paper's claims; claims beyond the paper do not count."""
        return overall([one.verdict for one in self.claim_results if not one.claim.beyond_paper])

    def seeds(self, arm: str) -> list[int]:
        return sorted(seed for name, seed in self.results if name == arm)

    @cached_property
    def values(self) -> dict[tuple[str, int], dict[str, float]]:
        return {key: result.values() for key, result in self.results.items()}

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
        """Return the variance of an effect, pooled over all arms with the same source; doubled for two arms.

        Arms of other sources are left out, since collections differ in their variance between seeds.
        """
        same = [arm for arm, source in self.sources.items() if source == self.sources[claim.better]]
        levels = {arm: found for arm in same if (found := self._levels(claim, arm))}
        return pooled(levels.values()) * (2 if claim.than in levels else 1)

    @property
    def sources(self) -> dict[str, str]:
        return {arm.name: arm.source for arm in (*self.figure.arms, *self.figure.real)}

    def _levels(self, claim: Claim, arm: str) -> list[float]:
        """Return the level of the scores of an arm, or of true samples, one a seed."""
        found = [self.truths[arm].values()] if arm in self.truths else [self.values[arm, s] for s in self.seeds(arm)]
        return [claim.level(values) for values in found if all(score in values for score in claim.scores)]

    def _unlike(self, claim: Claim) -> tuple[str, ...]:
        """Return whether an arm's seeds, or the claim's two arms, are of several commits, minutes or machines."""
        both = [[self.results[arm, seed].read() for seed in self.seeds(arm)] for arm in (claim.better, claim.than)]
        commits = [{made["environment"]["commit"] for made in arm} for arm in both]
        remarks = {"seeds of several commits": any(len(of_arm) > 1 for of_arm in commits)}
        if all(both):
            machines = [{tuple(made["environment"][key] for key in MACHINE) for made in arm} for arm in both]
            seconds = [mean(made["seconds"] for made in arm) for arm in both]
            times = seconds[0] / max(seconds[1], 1e-9)
            remarks |= {
                "other commits": commits[0] != commits[1],
                "other machines": machines[0] != machines[1],
                f"{times:.1f} times the minutes": not 0.8 < times < 1.25,
            }
        return tuple(remark for remark, applies in remarks.items() if applies)

    def _measured(self, claim: Claim) -> dict[str, float]:
        levels = {arm: self._levels(claim, arm) for arm in (claim.better, claim.than) if arm}
        return {arm: math.exp(mean(found)) for arm, found in levels.items() if found}
