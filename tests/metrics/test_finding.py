"""Findings: the word of a value between two levels, whichever side is bad."""

from __future__ import annotations

import math

import pytest

from unproject.metrics import Finding, Score, worst


def finding(value: float, doubtful: float, failed: float) -> Finding:
    return Finding("one", Score(value, "as given", 1), doubtful, failed, "it is so")


@pytest.mark.parametrize(
    "value, doubtful, failed, word",
    [
        (1.0, 1.4, 2.0, "good"),
        (1.4, 1.4, 2.0, "doubtful"),
        (2.0, 1.4, 2.0, "failed"),
        (0.9, 0.7, 0.3, "good"),
        (0.5, 0.7, 0.3, "doubtful"),
        (0.3, 0.7, 0.3, "failed"),
        (0.0, 0.5, -math.inf, "doubtful"),
        (9.0, 0.5, math.inf, "doubtful"),
        (math.nan, 0.5, math.inf, "failed"),
    ],
)
def test_the_word_follows_the_levels(value: float, doubtful: float, failed: float, word: str) -> None:
    assert finding(value, doubtful, failed).word == word


def test_the_worst_finding_decides() -> None:
    good, doubtful, failed = (finding(value, 1, 2) for value in (0, 1, 2))
    assert worst([good, doubtful, failed]) == "failed" and worst([good, doubtful]) == "doubtful"
    assert worst([good]) == "good" and worst([]) == "good"
