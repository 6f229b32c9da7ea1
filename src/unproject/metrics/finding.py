"""Finding: one thing that a run is judged by: what was measured, where it becomes doubtful or failed, what to do."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

from .score import Score

Word: TypeAlias = Literal["good", "doubtful", "failed"]
WORDS: tuple[Word, ...] = ("good", "doubtful", "failed")


@dataclass(frozen=True)
class Finding:
    """A score, and the levels from which on it is doubtful and failed; the second lies on the bad side of the first.

    Attributes:
        name: of what was measured.
        score: its value and protocol.
        doubtful, failed: levels; `failed` infinite if it never fails, with the sign of the bad side.
        says: the finding in one clause, without a full stop.
        advice: what to do next, in one clause, if it is not good.

    Examples:
        >>> from unproject.metrics import Finding, Score
        >>> share = Score(0.4, "share of volumes in one piece", n=64)
        >>> Finding("pieces", share, doubtful=0.5, failed=0.2, says="40 % of shapes are in one piece").word
        'doubtful'
    """

    name: str
    score: Score
    doubtful: float
    failed: float
    says: str
    advice: str = ""

    @property
    def word(self) -> Word:
        value, sign = self.score.value, math.copysign(1, self.failed - self.doubtful)
        if not math.isfinite(value) or sign * (value - self.failed) >= 0:
            return "failed"
        return "doubtful" if sign * (value - self.doubtful) >= 0 else "good"


def worst(findings: Iterable[Finding]) -> Word:
    """Return the worst word of findings; good if there are none."""
    return WORDS[max((WORDS.index(finding.word) for finding in findings), default=0)]
